//! A page that shows a moving surface as it is found.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tiny_http::Request;

use super::loopback::{LoopbackServer, Reply, Site, content};
use super::request::{Refusal, number};
use crate::error::CaptureError;

/// Longest wait of a request for the next surface: shorter than what browsers give up after.
const LONGEST_WAIT: Duration = Duration::from_secs(20);
/// Longest wait before looking whether to end.
const TICK: Duration = Duration::from_millis(200);

/// The files of the page.
#[derive(Clone, Debug)]
pub struct LiveFiles {
    /// The page, which asks for the others by `style.css` and by the names of scripts.
    pub page: String,
    /// The CSS of the page, which asks for it as `style.css`.
    pub style: String,
    /// The scripts of the page: name, as the page asks for it, and text.
    pub scripts: Vec<(&'static str, String)>,
}

/// The page, while it is served. It asks for `surface?after=N`; the answer waits until there is a surface that was
/// published after the Nth, and is the newest: who is slow misses some.
pub struct LivePage {
    shared: Arc<LiveSite>,
    server: LoopbackServer,
}

#[derive(Default)]
struct LiveState {
    /// Number of surfaces published so far.
    published: u64,
    /// The newest as a JSON object; empty before the first.
    surface: String,
    ended: bool,
}

struct LiveSite {
    files: LiveFiles,
    state: Mutex<LiveState>,
    changed: Condvar,
}

impl LivePage {
    /// Serves the page on 127.0.0.1 at `port`, 0 for any that is free.
    ///
    /// # Errors
    ///
    /// The port is taken.
    pub fn start(files: LiveFiles, port: u16) -> Result<Self, CaptureError> {
        let shared = Arc::new(LiveSite { files, state: Mutex::default(), changed: Condvar::new() });
        let server = LoopbackServer::start(shared.clone(), port)?;
        Ok(Self { shared, server })
    }

    /// Returns the page's address.
    pub fn address(&self) -> &str {
        self.server.address()
    }

    /// Shows a surface: a JSON object that the page's script understands.
    pub fn publish(&self, surface: String) {
        let mut state = self.shared.lock();
        state.published += 1;
        state.surface = surface;
        self.shared.changed.notify_all();
    }
}

impl std::fmt::Debug for LivePage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LivePage").field("address", &self.address()).finish_non_exhaustive()
    }
}

impl LiveSite {
    fn lock(&self) -> MutexGuard<'_, LiveState> {
        // A thread that panicked left a number and a text, nothing half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a surface after the `after`th.
    fn surface(&self, after: u64) -> Reply {
        let begun = Instant::now();
        let mut state = self.lock();
        while state.published <= after && begun.elapsed() < LONGEST_WAIT && !state.ended {
            state = self.changed.wait_timeout(state, TICK).unwrap_or_else(PoisonError::into_inner).0;
        }
        let LiveState { published, surface, ended } = &*state;
        let is_new = *published > after;
        let surface = if is_new && !surface.is_empty() { surface } else { "null" };
        content(
            "application/json",
            format!("{{\"published\":{published},\"ended\":{ended},\"surface\":{surface}}}").into_bytes(),
        )
    }
}

impl Site for LiveSite {
    fn reply(&self, path: &str, query: &str, is_post: bool, _: &mut Request) -> Result<Reply, Refusal> {
        if is_post {
            return Err(Refusal::Method);
        }
        Ok(match path {
            "" => content("text/html; charset=utf-8", self.files.page.clone().into()),
            "style.css" => content("text/css", self.files.style.clone().into()),
            "surface" => self.surface(number(query, "after").ok_or(Refusal::NotFound)?),
            other => {
                let script = self.files.scripts.iter().find(|(name, _)| *name == other);
                content("text/javascript", script.ok_or(Refusal::NotFound)?.1.clone().into())
            }
        })
    }

    fn end(&self) {
        self.lock().ended = true;
        self.changed.notify_all();
    }
}
