//! Arguments of `sequence`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Arguments of `nelu3d sequence`.
#[derive(Debug, clap::Args)]
pub(crate) struct SequenceArgs {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// A name under RIG/sequences, or a folder of frames.
    pub sequence: String,
    /// Pattern set (default: the rig's first).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// Color field (default: RIG/fields/SET.safetensors, as `calibrate` writes it).
    #[arg(long, value_name = "FILE")]
    pub field: Option<PathBuf>,
    /// Folder to write, or to go on with: one result folder per frame (default: RIG/results/SEQUENCE-SET).
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Evaluate every frame against the ground truth in truth/ of its folder.
    #[arg(long)]
    pub truth: bool,
    /// Number of frames from one keyframe, which starts without the previous frame, to the next. Stretches between
    /// keyframes can be computed in parallel.
    #[arg(long, value_name = "N", default_value = "30")]
    pub keyframe: NonZeroUsize,
    /// Compute only this part of the frames, as 1/8 to 8/8; parts may run at the same time, on
    /// any machines that share the folder.
    #[arg(long, value_name = "I/N")]
    pub shard: Option<nelu3d::sequence::Shard>,
    /// Write a script for the Slurm scheduler (`sbatch FILE`) instead of computing.
    #[arg(long, value_name = "FILE", conflicts_with = "shard")]
    pub slurm: Option<PathBuf>,
    /// Number of tasks of the Slurm script (default: one per stretch between keyframes).
    #[arg(long, value_name = "N", requires = "slurm")]
    pub tasks: Option<NonZeroUsize>,
    /// Show frames on a page in the browser as they arrive in the folder, at the rate that this machine gives, until
    /// Ctrl-C: the surface carried along, then the frame's own, refined while no newer one is there. Frames that are
    /// late are left out of the view, not of the folder; nothing is written.
    #[cfg(feature = "capture")]
    #[arg(long, conflicts_with_all = ["shard", "slurm"])]
    pub follow: bool,
    /// With --follow: after so many seconds with nothing to do but to wait for a frame, stop, and compute and write all
    /// frames of the folder, as without --follow.
    #[cfg(feature = "capture")]
    #[arg(long, value_name = "SECS", requires = "follow", value_parser = seconds)]
    pub idle: Option<f64>,
    /// With --follow: port of the page on 127.0.0.1 (default: any that is free).
    #[cfg(feature = "capture")]
    #[arg(long, value_name = "N", requires = "follow", default_value_t = 0)]
    pub port: u16,
    /// Frame rate at which the moving surface is played, frames per second.
    #[arg(long, value_name = "FPS", default_value_t = 10.0, value_parser = fps)]
    pub fps: f64,
    /// Write frames even if they are judged bad.
    #[arg(long)]
    pub accept: bool,
    /// Settings for moving scenes.
    #[command(flatten)]
    pub motion: nelu3d::sequence::MotionOptions,
    /// Settings of the method.
    #[command(flatten)]
    pub options: nelu3d::ReconstructionOptions,
}

/// Parses a frame rate.
fn fps(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(fps) if (0.01..=1000.0).contains(&fps) => Ok(fps),
        _ => Err("a number from 0.01 to 1000".into()),
    }
}

/// Parses a time to wait.
#[cfg(feature = "capture")]
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(secs) if (0.1..=86_400.0).contains(&secs) => Ok(secs),
        _ => Err("a number of seconds from 0.1 to 86400".into()),
    }
}
