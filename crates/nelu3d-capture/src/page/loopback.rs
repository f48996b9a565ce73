//! A small web server on the loopback interface, for pages of this program alone.

use std::hash::{BuildHasher, RandomState};
use std::io::{Cursor, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

use tiny_http::{Header, Method, Request, Response, Server};

use super::request::{Refusal, admit};
use crate::error::CaptureError;

/// An answer.
pub(super) type Reply = Response<Cursor<Vec<u8>>>;

/// Requests answered at the same time. One or two of them wait for something to happen.
const THREADS: usize = 6;

/// What a server answers with.
pub(super) trait Site: Send + Sync + 'static {
    /// Answers a request for `path`, below the address of the page, with `query` after its question mark. `is_post`
    /// says whether it is a POST; otherwise it is a GET.
    fn reply(&self, path: &str, query: &str, is_post: bool, request: &mut Request) -> Result<Reply, Refusal>;

    /// The server ends: nothing waits any longer.
    fn end(&self);
}

/// A server, while it serves: on 127.0.0.1 only, at an address with a secret token in it, and only to requests that
/// were meant for it (`Host`) and come from its own pages (`Origin`).
pub(super) struct LoopbackServer {
    site: Arc<dyn Site>,
    server: Arc<Server>,
    ended: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
    address: String,
}

impl LoopbackServer {
    /// Serves at `port`, 0 for any that is free.
    ///
    /// # Errors
    ///
    /// The port is taken.
    pub(super) fn start(site: Arc<dyn Site>, port: u16) -> Result<Self, CaptureError> {
        let fails = |e: &dyn std::fmt::Display| CaptureError::Device {
            device: format!("port {port} of 127.0.0.1"),
            problem: format!("cannot be used: {e}"),
            remedy: "choose another one".into(),
        };
        let server = Arc::new(Server::http(("127.0.0.1", port)).map_err(|e| fails(&e))?);
        let port = server.server_addr().to_ip().ok_or_else(|| fails(&"it has no address"))?.port();
        let token = token();
        let address = format!("http://127.0.0.1:{port}/{token}/");
        let own = vec![format!("127.0.0.1:{port}"), format!("localhost:{port}")];
        let ended = Arc::new(AtomicBool::new(false));
        let mut threads = Vec::new();
        for _ in 0..THREADS {
            let (server, site, ended) = (server.clone(), site.clone(), ended.clone());
            let (own, token) = (own.clone(), token.clone());
            threads.push(std::thread::spawn(move || {
                // Ends with an error when the server is told to unblock.
                while let Ok(request) = server.recv() {
                    answer(site.as_ref(), request, &own, &token);
                    if ended.load(Ordering::Relaxed) {
                        break;
                    }
                }
            }));
        }
        Ok(Self { site, server, ended, threads, address })
    }

    /// Returns the address of the first page.
    pub(super) fn address(&self) -> &str {
        &self.address
    }
}

impl Drop for LoopbackServer {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        self.site.end();
        for _ in 0..self.threads.len() {
            self.server.unblock();
        }
        for thread in self.threads.drain(..) {
            // A thread that panicked has nothing left to end.
            let _ = thread.join();
        }
    }
}

fn answer(site: &dyn Site, mut request: Request, own: &[String], token: &str) {
    let header = |request: &Request, name: &'static str| {
        let found = request.headers().iter().find(|h| h.field.equiv(name));
        found.map(|h| h.value.as_str().to_owned())
    };
    let (host, origin) = (header(&request, "Host"), header(&request, "Origin"));
    let is_post = *request.method() == Method::Post;
    let known = is_post || *request.method() == Method::Get;
    let url = request.url().to_owned();
    let done = match admit(is_post, &url, host.as_deref(), origin.as_deref(), own, token) {
        Ok(_) if !known => refuse(Refusal::Method),
        Ok((path, query)) => site.reply(path, query, is_post, &mut request).unwrap_or_else(refuse),
        Err(refusal) => refuse(refusal),
    };
    // A page that was closed meanwhile wants no answer.
    let _ = request.respond(done);
}

/// Answers with content of a media type.
pub(super) fn content(kind: &str, bytes: Vec<u8>) -> Reply {
    let mut response = Response::from_data(bytes);
    // Nothing but what is served here may be loaded or shown in a frame of another page.
    for (name, value) in [
        ("Content-Type", kind),
        ("Cache-Control", "no-store"),
        ("Content-Security-Policy", "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'"),
        ("X-Content-Type-Options", "nosniff"),
        ("Referrer-Policy", "no-referrer"),
    ] {
        response.add_header(Header::from_bytes(name, value).expect("a header of plain letters"));
    }
    response
}

/// Answers with a JSON value.
pub(super) fn json(value: &serde_json::Value) -> Reply {
    content("application/json", value.to_string().into_bytes())
}

fn refuse(refusal: Refusal) -> Reply {
    content("text/plain", Vec::new()).with_status_code(refusal as u16)
}

/// Reads a small JSON body.
pub(super) fn body<T: serde::de::DeserializeOwned>(request: &mut Request) -> Result<T, Refusal> {
    let mut text = String::new();
    request.as_reader().take(65_536).read_to_string(&mut text).map_err(|_| Refusal::NotFound)?;
    serde_json::from_str(&text).map_err(|_| Refusal::NotFound)
}

/// Returns 128 bits that nobody can guess: the standard library seeds its hashers from the system's randomness.
fn token() -> String {
    let word = || RandomState::new().hash_one(Instant::now());
    format!("{:016x}{:016x}", word(), word())
}
