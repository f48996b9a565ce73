//! The program `nelu3d` in a process of Python: what the command of that name, and `python -m nelu3d`, run.

use std::ffi::OsString;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

use nelu3d_cli::Program;
use pyo3::prelude::*;

/// Exit code of Rust's programs that panicked.
const PANICKED: u8 = 101;

/// Runs the program with the arguments that were typed after its name, and returns its exit code. The process is the
/// program's: it is run once, from the main thread.
///
/// # Errors
///
/// Another thread than the main one calls, which may not say what signals do.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, argv: Vec<OsString>) -> PyResult<u8> {
    // The program stops by itself at Ctrl-C. Python's handler, which is called as well where there is one, would raise
    // KeyboardInterrupt when it has.
    let signal = py.import("signal")?;
    signal.call_method1("signal", (signal.getattr("SIGINT")?, signal.getattr("SIG_DFL")?))?;
    let program = Program::Module {
        interpreter: py.import("sys")?.getattr("executable")?.extract::<Option<PathBuf>>()?.unwrap_or_default(),
        name: "nelu3d".into(),
        code: py.import("nelu3d._nelu3d")?.getattr("__file__")?.extract()?,
    };
    // What panicked has said so on standard error.
    let run = AssertUnwindSafe(|| nelu3d_cli::run(program, argv));
    Ok(py.detach(|| catch_unwind(run)).unwrap_or(PANICKED))
}
