//! What every command is given: progress, cancellation, and the way to its answer.

use std::ffi::OsString;
use std::io::{ErrorKind, Write};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::Result;
use nelu3d::{Progress, Sink};
use nelu3d_field::device::{self, Choice, Device};

use crate::console::Console;
use crate::program::Program;

/// What every command is given.
pub(crate) struct CommandContext {
    /// Where work reports to, and learns that it should stop.
    pub progress: Progress,
    /// What starts this program again.
    pub program: Program,
    /// What was typed after the program's name.
    pub typed: Vec<OsString>,
    console: Arc<Console>,
    cancel: Arc<AtomicBool>,
    json: bool,
}

/// A sink that shows nothing; warnings go to the log.
pub(crate) struct HiddenSink;

impl Sink for HiddenSink {
    fn stage(&self, _: &str) {}
    fn tick(&self, _: usize, _: usize) {}
    fn warn(&self, message: &str) {
        tracing::warn!("{message}");
    }
}

impl CommandContext {
    /// Creates a context that reports to `console`.
    pub(crate) fn new(
        console: Arc<Console>,
        cancel: Arc<AtomicBool>,
        json: bool,
        program: Program,
        typed: Vec<OsString>,
    ) -> Self {
        let progress = Progress::new(console.clone(), cancel.clone());
        Self { progress, program, typed, console, cancel, json }
    }

    /// Opens the device that work will be done on, before it begins, and says which it is.
    pub(crate) fn open_device(&self, choice: Choice) -> Result<()> {
        let device = Device::open(choice)?;
        match (choice, device.is_cpu()) {
            (Choice::Auto, true) if device::has_gpu_code() => {
                tracing::info!("no GPU: everything is done on the CPU (`nelu3d devices` says why)");
            }
            (_, false) => self.console.note(&format!("on {}", device.name())),
            _ => {}
        }
        Ok(())
    }

    /// Returns progress that is not shown, of work that stops when this does.
    pub(crate) fn silent(&self) -> Progress {
        Progress::new(Arc::new(HiddenSink), self.cancel.clone())
    }

    /// Returns progress that another sink receives, of work that stops when this does.
    pub(crate) fn heard_by(&self, sink: Arc<dyn Sink>) -> Progress {
        Progress::new(sink, self.cancel.clone())
    }

    /// Returns the flag that Ctrl-C raises.
    #[cfg(feature = "capture")]
    pub(crate) fn cancel(&self) -> Arc<AtomicBool> {
        self.cancel.clone()
    }

    /// Tells a person on standard error what they have to know to go on, quiet or not.
    #[cfg(feature = "capture")]
    pub(crate) fn tell(&self, message: &str) {
        self.console.say(message);
    }

    /// Fails if Ctrl-C was pressed: the last chance before an output is put into place.
    pub(crate) fn stop_if_asked(&self) -> Result<()> {
        if self.progress.cancelled() { Err(anyhow::anyhow!("stopped")) } else { Ok(()) }
    }

    /// Ends the last stage and prints the answer of a command on standard output: `text` for people, or `json`.
    pub(crate) fn answer(&self, json: &impl serde::Serialize, text: impl FnOnce() -> String) -> Result<()> {
        self.console.finish();
        let answer = if self.json { serde_json::to_string_pretty(json)? } else { text() };
        match writeln!(std::io::stdout().lock(), "{}", answer.trim_end()) {
            // `nelu3d … | head` has seen enough.
            Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
            Err(e) => {
                let remedy = match e.kind() {
                    ErrorKind::StorageFull => "free space on that disk, or send it elsewhere",
                    _ => "send it elsewhere",
                };
                Err(anyhow::anyhow!("standard output: the answer cannot be written: {e}; {remedy}"))
            }
            Ok(()) => Ok(()),
        }
    }
}
