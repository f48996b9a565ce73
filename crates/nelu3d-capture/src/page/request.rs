//! May this request be answered, and what does it ask for?

/// A request in words that no file is named by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    /// The page for people.
    Index,
    /// The page that shows the patterns.
    Screen,
    /// The script of one of the pages.
    Script(&'static str),
    /// The style of both.
    Style,
    /// An image to show: white, black, or the pattern of this number.
    Slide(String),
    /// The next slide after this sequence number; the answer waits for it.
    Next(u64),
    /// The status.
    Status,
    /// The live picture.
    Live,
    /// A slide is on the screen.
    Shown,
    /// A frame of the webcam: width and height.
    Frame(usize, usize),
    /// What the webcam is.
    Webcam,
    /// A button was pressed.
    Command,
}

/// Why a request is refused: the status code of HTTP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// It was meant for another host, or comes from another page.
    Forbidden = 403,
    /// There is no such thing.
    NotFound = 404,
    /// It is no GET where it should be, or no POST.
    Method = 405,
}

/// Decides whether a request is answered at all: it must be meant for this server and come from one of its own pages,
/// at the address with the token. Returns its path below that address, and its query. `own` are the names by which this
/// server may be called, as `127.0.0.1:8080`.
pub(super) fn admit<'a>(
    is_post: bool,
    url: &'a str,
    host: Option<&str>,
    origin: Option<&str>,
    own: &[String],
    token: &str,
) -> Result<(&'a str, &'a str), Refusal> {
    // A name that resolves to 127.0.0.1 would let any web page in (DNS rebinding).
    if !host.is_some_and(|host| own.iter().any(|o| o == host)) {
        return Err(Refusal::Forbidden);
    }
    let is_own = |origin: &str| origin.strip_prefix("http://").is_some_and(|o| own.iter().any(|own| own == o));
    if origin.is_some_and(|origin| !is_own(origin)) || (is_post && origin.is_none()) {
        return Err(Refusal::Forbidden);
    }
    let (path, query) = url.split_once('?').unwrap_or((url, ""));
    let rest = path.strip_prefix('/').and_then(|p| p.split_once('/')).filter(|(t, _)| same(t, token));
    Ok((rest.ok_or(Refusal::NotFound)?.1, query))
}

/// Returns a number in a query.
pub(super) fn number(query: &str, key: &str) -> Option<u64> {
    query.split('&').filter_map(|pair| pair.split_once('=')).find(|(k, _)| *k == key)?.1.parse().ok()
}

impl Asked {
    /// Returns what is asked for at a path below the address of the pages.
    pub(super) fn at(path: &str, query: &str, is_post: bool) -> Result<Self, Refusal> {
        let side = |key| number(query, key).and_then(|n| usize::try_from(n).ok()).filter(|n| (1..=16_384).contains(n));
        let (asked, posts) = match path {
            "" => (Asked::Index, false),
            "screen" => (Asked::Screen, false),
            "index.js" => (Asked::Script("index"), false),
            "screen.js" => (Asked::Script("screen"), false),
            "style.css" => (Asked::Style, false),
            "next" => (Asked::Next(number(query, "after").ok_or(Refusal::NotFound)?), false),
            "status" => (Asked::Status, false),
            "live.png" => (Asked::Live, false),
            "shown" => (Asked::Shown, true),
            "frame" => match (side("width"), side("height")) {
                (Some(w), Some(h)) => (Asked::Frame(w, h), true),
                _ => return Err(Refusal::NotFound),
            },
            "webcam" => (Asked::Webcam, true),
            "command" => (Asked::Command, true),
            _ => match path.strip_prefix("slide/") {
                Some(name) => (Asked::Slide(name.into()), false),
                None => return Err(Refusal::NotFound),
            },
        };
        if posts == is_post { Ok(asked) } else { Err(Refusal::Method) }
    }
}

/// Compares two secrets in a time that does not tell how much of them is equal.
fn same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |d, (a, b)| d | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judge(
        is_post: bool,
        url: &str,
        host: Option<&str>,
        origin: Option<&str>,
        own: &[String],
        token: &str,
    ) -> Result<Asked, Refusal> {
        let (path, query) = admit(is_post, url, host, origin, own, token)?;
        Asked::at(path, query, is_post)
    }

    #[test]
    fn strangers_are_refused() {
        let own = ["127.0.0.1:8080".to_owned(), "localhost:8080".to_owned()];
        let get = |url: &str, host, origin| judge(false, url, host, origin, &own, "secret");
        let post = |url: &str, origin| judge(true, url, Some("localhost:8080"), origin, &own, "secret");
        let home = Some("127.0.0.1:8080");
        assert_eq!(get("/secret/", home, None), Ok(Asked::Index));
        assert_eq!(get("/secret/next?after=7", home, Some("http://localhost:8080")), Ok(Asked::Next(7)));
        assert_eq!(get("/secret/slide/3", home, None), Ok(Asked::Slide("3".into())));
        assert_eq!(post("/secret/frame?width=4&height=2", Some("http://localhost:8080")), Ok(Asked::Frame(4, 2)));
        for host in [None, Some("127.0.0.1"), Some("127.0.0.1:81"), Some("evil.example:8080")] {
            assert_eq!(get("/secret/", host, None), Err(Refusal::Forbidden), "{host:?}");
        }
        for origin in ["http://evil.example", "null", "https://localhost:8080", "http://localhost:8081"] {
            assert_eq!(get("/secret/", home, Some(origin)), Err(Refusal::Forbidden), "{origin}");
            assert_eq!(post("/secret/command", Some(origin)), Err(Refusal::Forbidden), "{origin}");
        }
        // A form of another page may come without an origin.
        assert_eq!(post("/secret/command", None), Err(Refusal::Forbidden));
        for url in
            ["/", "/secret", "/secre/", "/Secret/", "//", "/secret/../rig.toml", "/secret/frame?width=0&height=1"]
        {
            assert!(matches!(get(url, home, None), Err(Refusal::NotFound)), "{url}");
        }
        assert_eq!(get("/secret/command", home, None), Err(Refusal::Method));
        assert_eq!(post("/secret/status", Some("http://localhost:8080")), Err(Refusal::Method));
    }
}
