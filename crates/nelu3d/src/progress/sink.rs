//! How long work tells its caller where it stands, and how the caller tells it to stop. The library never prints.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Receives what happens during long work. Called from the thread that runs the work, and from its workers.
pub trait Sink: Send + Sync {
    /// A new stage begins; the one before it is done.
    fn stage(&self, name: &str);
    /// `done` of `total` parts of the current stage are done.
    fn tick(&self, done: usize, total: usize);
    /// Something the user should know that does not stop the work: one sentence.
    fn warn(&self, message: &str);
}

/// A handle on a [`Sink`] and a cancel flag; cheap to clone. The default reports to nobody and is never cancelled.
#[derive(Clone, Default)]
pub struct Progress {
    sink: Option<Arc<dyn Sink>>,
    cancel: Arc<AtomicBool>,
}

impl Progress {
    /// Reports to `sink`; the work stops soon after somebody sets `cancel`.
    pub fn new(sink: Arc<dyn Sink>, cancel: Arc<AtomicBool>) -> Self {
        Self { sink: Some(sink), cancel }
    }

    /// Reports to nobody.
    pub fn none() -> Self {
        Self::default()
    }

    /// A new stage begins. Short and lower case: `read images`, `fit the field`.
    pub fn stage(&self, name: &str) {
        if let Some(sink) = &self.sink {
            sink.stage(name);
        }
    }

    /// `done` of `total` parts of the current stage are done.
    pub fn tick(&self, done: usize, total: usize) {
        if let Some(sink) = &self.sink {
            sink.tick(done, total);
        }
    }

    /// Something the user should know that does not stop the work: one sentence.
    pub fn warn(&self, message: impl AsRef<str>) {
        if let Some(sink) = &self.sink {
            sink.warn(message.as_ref());
        }
    }

    /// Whether to stop. Work that sees `true` returns its module's `Cancelled` error and leaves nothing half written.
    pub fn cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }
}

impl std::fmt::Debug for Progress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Progress").field("reports", &self.sink.is_some()).field("cancelled", &self.cancelled()).finish()
    }
}
