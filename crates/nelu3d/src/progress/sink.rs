//! Reports of long work to its caller, and cancellation by the caller. The library never prints.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cpu_time::ProcessTime;
use nelu3d_field::bench::Demand;

/// Receives the reports of long work. It is called from the thread that runs the work, and from its workers.
pub trait Sink: Send + Sync {
    /// Receives that a new stage begins; the one before it is done.
    fn stage(&self, name: &str);
    /// Receives that `done` of `total` parts of the current stage are done.
    fn tick(&self, done: usize, total: usize);
    /// Receives one sentence that the user should know and that does not stop the work.
    fn warn(&self, message: &str);
    /// Receives that a named part of the current stage took some processor time, s, of all threads, and what it asked
    /// of the machine, counted by hand. Parts come again in every iteration. By default nobody wants to know.
    fn worked(&self, part: &str, cpu_secs: f64, demand: &Demand) {
        let _ = (part, cpu_secs, demand);
    }
}

/// A handle on a [`Sink`] and a cancel flag; cheap to clone. The default reports to nobody and is never cancelled.
#[derive(Clone, Default)]
pub struct Progress {
    sink: Option<Arc<dyn Sink>>,
    cancel: Arc<AtomicBool>,
}

impl Progress {
    /// Makes a handle that reports to `sink`; the work stops soon after `cancel` is set.
    pub fn new(sink: Arc<dyn Sink>, cancel: Arc<AtomicBool>) -> Self {
        Self { sink: Some(sink), cancel }
    }

    /// Makes a handle that reports to nobody.
    pub fn none() -> Self {
        Self::default()
    }

    /// Reports that a new stage begins. Names are short and lower case: `read images`, `fit the field`.
    pub fn stage(&self, name: &str) {
        if let Some(sink) = &self.sink {
            sink.stage(name);
        }
    }

    /// Reports that `done` of `total` parts of the current stage are done.
    pub fn tick(&self, done: usize, total: usize) {
        if let Some(sink) = &self.sink {
            sink.tick(done, total);
        }
    }

    /// Reports one sentence that the user should know and that does not stop the work.
    pub fn warn(&self, message: impl AsRef<str>) {
        if let Some(sink) = &self.sink {
            sink.warn(message.as_ref());
        }
    }

    /// Runs a part of a stage, which returns its result and what it asked of the machine, and reports its processor
    /// time.
    pub fn measure<T>(&self, part: &str, run: impl FnOnce() -> (T, Demand)) -> T {
        let start = self.sink.as_ref().map(|sink| (sink, ProcessTime::now()));
        let (result, demand) = run();
        if let Some((sink, start)) = start {
            sink.worked(part, start.elapsed().as_secs_f64(), &demand);
        }
        result
    }

    /// Returns whether anybody hears the reports.
    pub fn is_heard(&self) -> bool {
        self.sink.is_some()
    }

    /// Returns whether to stop. Work that has to stop returns its module's `Cancelled` error and leaves nothing half
    /// written.
    pub fn cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }
}

impl std::fmt::Debug for Progress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Progress").field("reports", &self.sink.is_some()).field("cancelled", &self.cancelled()).finish()
    }
}
