//! The program `nelu3d`: scan with a camera and any light source that throws a pattern.
//!
//! The path through it: [`args`] is what was typed, each module of [`commands`] turns its part into what it means and
//! runs the library, [`console`] is everything a person sees meanwhile, [`errors`] what they read when it fails. What a
//! machine reads is one JSON value on standard output (`--json`); everything else goes to standard error, except the
//! answer a person asked for.
//!
//! Exit codes: 0 done (perhaps with warnings), 1 failed, judged bad or stopped by Ctrl-C, 2 wrong usage, 129 and 143
//! stopped by SIGHUP and SIGTERM.

mod args;
mod commands;
mod console;
mod context;
mod errors;
mod experiment;
mod paths;
mod signals;
mod verdict;

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context as _;
use clap::Parser;

use args::{Args, Command};
use console::Console;
use context::CommandContext;
use signals::StopRequest;

fn main() -> ExitCode {
    // Wrong usage ends here, with clap's explanation and exit code 2.
    let args = Args::parse();
    let console = Arc::new(Console::new(args.global.quiet));
    console.clone().log(args.global.verbose);
    let stop = match StopRequest::listen() {
        Ok(stop) => stop,
        Err(e) => {
            console.say(&format!("nelu3d: cannot listen for Ctrl-C: {e}; try again"));
            return ExitCode::FAILURE;
        }
    };
    match run(args, &console, &stop.requested) {
        Ok(code) => {
            console.finish();
            code
        }
        Err(e) => {
            console.abandon();
            if stop.requested.load(Ordering::Relaxed) {
                console.say("nelu3d: stopped; nothing half written was left behind");
                ExitCode::from(stop.exit_code())
            } else {
                console.say(&format!("nelu3d: {}", errors::sentence(&e)));
                ExitCode::FAILURE
            }
        }
    }
}

/// Runs the command that was typed.
fn run(args: Args, console: &Arc<Console>, cancel: &Arc<AtomicBool>) -> anyhow::Result<ExitCode> {
    if let Some(n) = args.global.threads {
        rayon::ThreadPoolBuilder::new().num_threads(n.get()).build_global().context("cannot start the threads")?;
    }
    let context = CommandContext::new(console.clone(), cancel.clone(), args.global.json);
    match args.command {
        Command::Demo(a) => commands::demo::run(a, &context),
        Command::Simulate(a) => commands::simulate::run(a, &context),
        Command::Board(a) => commands::board::run(a, &context),
        Command::Camera(a) => commands::camera::run(a, &context),
        Command::Patterns(a) => commands::patterns::run(a, &context),
        #[cfg(feature = "capture")]
        Command::Capture(a) => commands::capture::run(a, &context),
        Command::Import(a) => commands::import::run(a, &context),
        Command::Check(a) => commands::check::run(a, &context),
        Command::Calibrate(a) => commands::calibrate::run(a, &context),
        Command::Reconstruct(a) => commands::reconstruct::run(a, &context),
        Command::Sequence(a) => commands::sequence::run(&a, &context),
        Command::Decode(a) => commands::decode::run(a, &context),
        Command::Projector(a) => commands::projector::run(a, &context),
        Command::Evaluate(a) => commands::evaluate::run(a, &context),
        Command::Experiment(a) => experiment::run(&a, &context),
        Command::Table(a) => commands::table::run(a, &context),
        Command::Bench(a) => commands::bench::run(a, &context),
        Command::Devices => commands::devices::run(&context),
        Command::Manual(a) => commands::manual::run(a, &context),
    }
}
