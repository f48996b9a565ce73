//! The program `nelu3d`: scan with a camera and any light source that throws a pattern.
//!
//! [`run`] is all of it: the executable `nelu3d` calls it, and so does the Python package. The path through it: `args`
//! is what was typed, each module of `commands` turns its part into what it means and runs the library, `console` is
//! everything a person sees meanwhile, `errors` what they read when it fails. What a machine reads is one JSON value on
//! standard output (`--json`); everything else goes to standard error, except the answer a person asked for.

mod args;
mod commands;
mod console;
mod context;
mod errors;
mod experiment;
mod paths;
mod program;
mod signals;
mod verdict;

use std::ffi::OsString;
use std::io::Write as _;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use anyhow::Context as _;
use clap::Parser as _;

use args::{Args, Command};
use console::Console;
use context::CommandContext;
use signals::StopRequest;

pub use program::Program;

/// Exit code of a command that did what it was asked to.
const DONE: u8 = 0;
/// Exit code of a command that failed, or that found something to be bad.
const FAILED: u8 = 1;

/// Runs the program with `arguments`, what was typed after its name, and returns its exit code: 0 done (perhaps with
/// warnings), 1 failed, judged bad or stopped by Ctrl-C, 2 wrong usage, 129 and 143 stopped by SIGHUP and SIGTERM.
///
/// The process is the program's from here on: it takes over these signals, the log, and the pool of threads, and a
/// second signal ends the process on the spot.
///
/// # Panics
///
/// If it is run a second time in one process.
pub fn run(program: Program, arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let typed: Vec<OsString> = arguments.into_iter().collect();
    let code = match Args::try_parse_from(std::iter::once("nelu3d".into()).chain(typed.iter().cloned())) {
        Ok(args) => start(args, program, typed),
        Err(e) => {
            // Help, the version, or what is wrong with what was typed. The terminal may have gone.
            let _ = e.print();
            u8::try_from(e.exit_code()).unwrap_or(FAILED)
        }
    };
    // In an interpreter nobody else does that at the end.
    let _ = std::io::stdout().flush();
    code
}

/// Listens for signals, runs the command that was typed, and tells how it ended.
fn start(args: Args, program: Program, typed: Vec<OsString>) -> u8 {
    let console = Arc::new(Console::new(args.global.quiet));
    console.clone().log(args.global.verbose);
    let stop = match StopRequest::listen() {
        Ok(stop) => stop,
        Err(e) => {
            console.say(&format!("nelu3d: cannot listen for Ctrl-C: {e}; try again"));
            return FAILED;
        }
    };
    let context = CommandContext::new(console.clone(), stop.requested.clone(), args.global.json, program, typed);
    match command(args, &context) {
        Ok(code) => {
            console.finish();
            code
        }
        Err(e) => {
            console.abandon();
            if stop.requested.load(Ordering::Relaxed) {
                console.say("nelu3d: stopped; nothing half written was left behind");
                stop.exit_code()
            } else {
                console.say(&format!("nelu3d: {}", errors::sentence(&e)));
                FAILED
            }
        }
    }
}

/// Runs the command that was typed, and returns its exit code.
fn command(args: Args, context: &CommandContext) -> anyhow::Result<u8> {
    if let Some(n) = args.global.threads {
        rayon::ThreadPoolBuilder::new().num_threads(n.get()).build_global().context("cannot start the threads")?;
    }
    match args.command {
        Command::Demo(a) => commands::demo::run(a, context),
        Command::Simulate(a) => commands::simulate::run(a, context),
        Command::Board(a) => commands::board::run(a, context),
        Command::Camera(a) => commands::camera::run(a, context),
        Command::Patterns(a) => commands::patterns::run(a, context),
        #[cfg(feature = "capture")]
        Command::Capture(a) => commands::capture::run(a, context),
        Command::Import(a) => commands::import::run(a, context),
        Command::Check(a) => return Ok(if commands::check::run(a, context)? { DONE } else { FAILED }),
        Command::Calibrate(a) => commands::calibrate::run(a, context),
        Command::Reconstruct(a) => commands::reconstruct::run(a, context),
        Command::Sequence(a) => commands::sequence::run(&a, context),
        Command::Decode(a) => commands::decode::run(a, context),
        Command::Projector(a) => commands::projector::run(a, context),
        Command::Evaluate(a) => commands::evaluate::run(a, context),
        Command::Experiment(a) => experiment::run(&a, context),
        Command::Table(a) => commands::table::run(a, context),
        Command::Bench(a) => commands::bench::run(a, context),
        Command::Devices => commands::devices::run(context),
        Command::Manual(a) => commands::manual::run(a, context),
    }?;
    Ok(DONE)
}
