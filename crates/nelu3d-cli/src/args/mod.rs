//! What is typed. What it means is decided by each command.
//!
//! One file per group of commands. A default is stated once, by `Default` of the options that a command takes.

mod baselines;
mod board;
mod calibrate;
mod camera;
#[cfg(feature = "capture")]
mod capture;
mod demo;
mod evaluate;
mod machine;
mod manual;
mod mesh_format;
mod patterns;
mod reconstruct;
mod rig;
mod sequence;

use std::num::NonZeroUsize;

use clap::{Parser, Subcommand};

pub(crate) use baselines::{DecodeArgs, ProjectorArgs, TableArgs, TableCommand, TableExportArgs, TableInfoArgs};
pub(crate) use board::{BoardArgs, BoardCommand, PrintArgs};
pub(crate) use calibrate::CalibrateArgs;
pub(crate) use camera::CameraArgs;
#[cfg(feature = "capture")]
pub(crate) use capture::{CaptureArgs, NewRigArgs};
pub(crate) use demo::{DemoArgs, SimulateArgs};
pub(crate) use evaluate::{EvaluateArgs, ExperimentArgs};
pub(crate) use machine::BenchArgs;
pub(crate) use manual::ManualArgs;
pub(crate) use mesh_format::{MeshFormat, OtherFormat};
pub(crate) use patterns::{AxisChoice, PatternImageArgs, PatternScoreArgs, PatternsCommand, RgbArgs};
pub(crate) use reconstruct::ReconstructArgs;
pub(crate) use rig::{CheckArgs, ImportArgs};
pub(crate) use sequence::SequenceArgs;

#[cfg(feature = "capture")]
use patterns::size as parse_size;
#[cfg(feature = "capture")]
use rig::channels as parse_channels;
use rig::code as parse_code;

/// Exit codes, which scripts can rely on.
const EXIT_CODES: &str = "Exit codes: 0 done, 1 failed, judged bad or stopped by Ctrl-C, 2 wrong usage, 129 or 143 \
                          stopped by SIGHUP or SIGTERM. What fails says so in one sentence on standard error, and \
                          leaves no half-written output behind.";

/// 3D scanning with a camera and any light source that throws a pattern.
///
/// No projector model: a board is moved through the scene once, and what each point of space looks like under the
/// patterns is learned (a color field). Scenes are then explained by it. Start with `nelu3d demo`.
#[derive(Debug, Parser)]
#[command(name = "nelu3d", version, max_term_width = 100, after_help = EXIT_CODES)]
pub(crate) struct Args {
    /// Options that every command takes.
    #[command(flatten)]
    pub global: GlobalArgs,
    /// The command to run.
    #[command(subcommand)]
    pub command: Command,
}

/// Options that every command takes.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Global options")]
pub(crate) struct GlobalArgs {
    /// Print the answer as one JSON value on standard output.
    #[arg(long, global = true)]
    pub json: bool,
    /// Show no progress on standard error.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Log more; twice for much more. NELU3D_LOG takes levels by module: `debug`, or `nelu3d::reconstruct=debug,info`.
    #[arg(long, short, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Threads to use (default: all).
    #[arg(long, global = true, value_name = "N", value_parser = threads)]
    pub threads: Option<NonZeroUsize>,
}

/// Parses a number of threads. Each takes memory of its own, and more than there are cores make nothing faster.
fn threads(text: &str) -> Result<NonZeroUsize, String> {
    const MOST: usize = 1024;
    match text.parse::<NonZeroUsize>() {
        Ok(n) if n.get() <= MOST => Ok(n),
        _ => Err(format!("give a number from 1 to {MOST}; without --threads, every core gets one")),
    }
}

/// The commands of the program.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Simulate a small scanner, calibrate it, reconstruct a scene and evaluate the result: no input, no hardware.
    Demo(DemoArgs),
    /// Write the rig folder of a virtual scanner, with exact ground truth.
    Simulate(SimulateArgs),
    /// Print a board: PDF, SVG or PNG true to scale, and its lines for rig.toml.
    Board(BoardArgs),
    /// Calibrate the camera from images of a board, or from the rig's own sweep; or measure its response.
    Camera(CameraArgs),
    /// Make the images a light source shows, or score such images as a code.
    #[command(subcommand)]
    Patterns(PatternsCommand),
    /// Take a sweep and scenes with a camera and a projector: a page in the browser shows the patterns.
    #[cfg(feature = "capture")]
    Capture(CaptureArgs),
    /// Turn a recording, a folder of numbered frames, into a sequence, a scene or the sweep of a rig.
    Import(ImportArgs),
    /// List everything that is wrong with a rig folder, in one go.
    Check(CheckArgs),
    /// Turn the board sweep of a rig into a color field.
    Calibrate(CalibrateArgs),
    /// Reconstruct a scene.
    Reconstruct(ReconstructArgs),
    /// Reconstruct a moving scene, frame after frame; goes on where it was stopped.
    Sequence(SequenceArgs),
    /// Decode a scene with a baseline: the methods that NeLU3D is compared with.
    Decode(DecodeArgs),
    /// Calibrate the projector from the sweep, if it has Gray-code images along x and y; only baselines and
    /// --from-projector need it.
    Projector(ProjectorArgs),
    /// Evaluate a result against ground truth, a CAD mesh or another result.
    Evaluate(EvaluateArgs),
    /// Run the paper's tables and figures, or studies of your own, on virtual and given rigs.
    Experiment(ExperimentArgs),
    /// Write lookup tables of the sweep in the files of the LookUp3D tools, or describe such a file.
    Table(TableArgs),
    /// Measure this machine, and how close kernels and training steps come to its limits.
    Bench(BenchArgs),
    /// List the GPUs that were found, and why one is not used.
    Devices,
    /// Write manual pages and completions for shells, for packages of this program.
    #[command(hide = true)]
    Manual(ManualArgs),
}

#[cfg(test)]
mod tests;
