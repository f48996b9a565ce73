//! Pieces of a page: text made safe, tables, pictures, figures, tiles, and templates filled in.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use colorous::Gradient;
use nelu3d::result::picture::Picture;

use super::number::short;

/// Maximum width of pictures of maps, so that a page stays small, px.
pub const MAX_MAP_WIDTH: usize = 640;

/// Makes text safe to stand anywhere in a page, attributes in quotes included.
pub fn escape(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut s, c| {
        match c {
            '&' => s.push_str("&amp;"),
            '<' => s.push_str("&lt;"),
            '>' => s.push_str("&gt;"),
            '"' => s.push_str("&quot;"),
            '\'' => s.push_str("&#39;"),
            c => s.push(c),
        }
        s
    })
}

/// Replaces each `{{name}}` of a template, in one pass: what is put in is not looked at again.
pub fn fill(template: &str, parts: &[(&str, String)]) -> String {
    let mut out = String::with_capacity(template.len() + parts.iter().map(|p| p.1.len()).sum::<usize>());
    let mut rest = template;
    while let Some(start) = rest.find("{{") {
        let end = start + rest[start..].find("}}").expect("the template closes its braces");
        let name = &rest[start + 2..end];
        out.push_str(&rest[..start]);
        out.push_str(&parts.iter().find(|p| p.0 == name).expect("the template's names are known").1);
        rest = &rest[end + 2..];
    }
    out + rest
}

/// Returns a table that scrolls sideways by itself; cells are text, not HTML.
pub fn table<S: AsRef<str>>(headings: &[&str], rows: &[Vec<S>]) -> String {
    let mut html = "<div class=scroll><table><tr>".to_owned();
    for h in headings {
        let _ = write!(html, "<th>{}</th>", escape(h));
    }
    html.push_str("</tr>");
    for row in rows {
        html.push_str("<tr>");
        for cell in row {
            let _ = write!(html, "<td>{}</td>", escape(cell.as_ref()));
        }
        html.push_str("</tr>");
    }
    html.push_str("</table></div>");
    html
}

/// Returns large numbers with a label each: what one looks for first.
pub fn tiles<S: AsRef<str>>(tiles: &[(S, S)]) -> String {
    let html = tiles.iter().fold(String::new(), |mut html, (number, label)| {
        let (number, label) = (escape(number.as_ref()), escape(label.as_ref()));
        let _ = write!(html, "<div class=tile><b>{number}</b><span>{label}</span></div>");
        html
    });
    format!("<div class=tiles>{html}</div>")
}

/// Returns a picture, an SVG or anything else in a frame, with its name and a few words on what it is above it.
pub fn figure(name: &str, note: &str, content: &str) -> String {
    let (name, note) = (escape(name), escape(note));
    format!("<figure><figcaption><b>{name}</b> <span>{note}</span></figcaption>{content}</figure>")
}

/// Returns a picture in a frame with its name below it.
pub fn thumbnail(picture: &Picture, name: &str) -> String {
    format!("<figure>{}<figcaption>{}</figcaption></figure>", img(picture, name), escape(name))
}

/// Returns a picture inside the page.
pub fn img(picture: &Picture, alt: &str) -> String {
    let [w, h] = picture.size();
    let data = STANDARD.encode(picture.png());
    format!("<img width={w} height={h} alt=\"{}\" src=\"data:image/png;base64,{data}\">", escape(alt))
}

/// Returns a bar of colors with five labels, `range[0]` at the left in the gradient's first color unless the range is
/// reversed.
pub fn color_bar(gradient: Gradient, range: [f64; 2], unit: &str) -> String {
    let stops: Vec<String> =
        (0..=16).map(|i| gradient.eval_continuous(f64::from(i) / 16.0)).map(|c| format!("#{c:x}")).collect();
    let labels = (0..5).fold(String::new(), |mut s, i| {
        let v = range[0] + (range[1] - range[0]) * f64::from(i) / 4.0;
        let unit = if i == 4 && !unit.is_empty() { format!(" {unit}") } else { String::new() };
        let _ = write!(s, "<span>{}{}</span>", short(v), escape(&unit));
        s
    });
    format!(
        "<div class=bar style='background:linear-gradient(to right,{})'></div><div class=ticks>{labels}</div>",
        stops.join(",")
    )
}

/// Returns what colors mean, one label each.
pub fn legend(items: &[([u8; 3], &str)]) -> String {
    let items = items.iter().fold(String::new(), |mut s, ([r, g, b], label)| {
        let _ = write!(s, "<span><i style='background:rgb({r},{g},{b})'></i>{}</span>", escape(label));
        s
    });
    format!("<div class=legend>{items}</div>")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_put_in_is_not_filled_again() {
        let parts = [("a", "{{b}}".to_owned()), ("b", "B".to_owned())];
        assert_eq!(fill("<{{a}}|{{b}}>", &parts), "<{{b}}|B>");
    }

    #[test]
    fn names_cannot_break_the_page() {
        assert_eq!(escape("<b x='1'>\"&"), "&lt;b x=&#39;1&#39;&gt;&quot;&amp;");
    }
}
