//! The program `nelu3d`: all of it is the library beside it, which the Python package runs too.

use std::process::ExitCode;

use nelu3d_cli::{Program, run};

fn main() -> ExitCode {
    run(Program::Executable, std::env::args_os().skip(1)).into()
}
