//! Long work: without the interpreter's lock, with progress, warnings, and Ctrl-C.
//!
//! The work has a thread of its own. The thread that called waits for its reports, hands them to Python, and asks for
//! signals in between; a signal, or an exception of the callback, stops the work at its next chance.

use std::any::Any;
use std::ffi::CString;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use nelu3d::{Progress, Sink};
use pyo3::prelude::*;

use crate::error::{Error, Problem, ScanWarning};

/// How long signals wait at most.
const PATIENCE: Duration = Duration::from_millis(50);

/// A report of the work.
enum Report {
    Stage(String),
    Tick(usize, usize),
    Warning(String),
}

/// Sends reports to the thread that called.
struct Reporter(Sender<Report>);

impl Sink for Reporter {
    fn stage(&self, name: &str) {
        self.send(Report::Stage(name.into()));
    }

    fn tick(&self, done: usize, total: usize) {
        self.send(Report::Tick(done, total));
    }

    fn warn(&self, message: &str) {
        self.send(Report::Warning(message.into()));
    }
}

impl Reporter {
    fn send(&self, report: Report) {
        // The receiver lives as long as the work.
        let _ = self.0.send(report);
    }
}

/// Runs `work` and returns what it returned. `callback` is called as `callback(stage, done, total)`, with `total` 0
/// when a stage begins.
///
/// # Errors
///
/// What went wrong; a signal's exception; an exception of the callback; a panic.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    callback: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Progress) -> Result<T, Problem> + Send,
) -> PyResult<T> {
    let (sender, reports) = channel();
    let (reports, cancel) = (Mutex::new(reports), Arc::new(AtomicBool::new(false)));
    let progress = Progress::new(Arc::new(Reporter(sender)), cancel.clone());
    std::thread::scope(|scope| {
        // With the work its progress ends, and with that the reports.
        let worker = scope.spawn(move || work(&progress));
        let raised = listen(py, callback, &reports, &cancel);
        match (worker.join(), raised) {
            (_, Err(exception)) => Err(exception),
            (Ok(Ok(made)), Ok(())) => Ok(made),
            (Ok(Err(problem)), Ok(())) => Err(problem.exception()),
            (Err(panic), Ok(())) => Err(Error::new_err(format!(
                "nelu3d itself failed ({}): report this at its repository",
                said(panic.as_ref())
            ))),
        }
    })
}

/// Hands reports to Python until there are no more. The first exception stops the work, and is returned when it has.
fn listen(
    py: Python<'_>,
    callback: Option<&Bound<'_, PyAny>>,
    reports: &Mutex<Receiver<Report>>,
    cancel: &AtomicBool,
) -> PyResult<()> {
    let (mut stage, mut raised) = (String::new(), Ok(()));
    loop {
        let next = py.detach(|| reports.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(PATIENCE));
        let told = match next {
            Err(RecvTimeoutError::Disconnected) => return raised,
            Err(RecvTimeoutError::Timeout) => Ok(()),
            // Who was interrupted wants to hear no more.
            Ok(_) if raised.is_err() => Ok(()),
            Ok(Report::Stage(name)) => {
                stage = name;
                tell(callback, &stage, 0, 0)
            }
            Ok(Report::Tick(done, total)) => tell(callback, &stage, done, total),
            Ok(Report::Warning(message)) => warn(py, &message),
        };
        if let Err(exception) = told.and_then(|()| py.check_signals()) {
            cancel.store(true, Ordering::Relaxed);
            raised = raised.and(Err(exception));
        }
    }
}

fn tell(callback: Option<&Bound<'_, PyAny>>, stage: &str, done: usize, total: usize) -> PyResult<()> {
    callback.map_or(Ok(()), |callback| callback.call1((stage, done, total)).map(drop))
}

/// Issues a `nelu3d.ScanWarning`.
pub(crate) fn warn(py: Python<'_>, message: &str) -> PyResult<()> {
    let text = CString::new(message.replace('\0', " ")).expect("no zeros are left");
    PyErr::warn(py, &py.get_type::<ScanWarning>(), &text, 1)
}

/// Returns what a panic said.
fn said(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic")
}

/// Returns the device of a name: "auto", "cpu", "gpu", or "gpu:N".
pub(crate) fn device(name: &str) -> PyResult<nelu3d_field::device::Choice> {
    name.parse().map_err(|e| Error::new_err(format!("device: {name:?}: {e}")))
}
