//! Arguments of `decode`, `projector` and `table`: the baselines and what they need.

use std::path::PathBuf;

use clap::Subcommand;
use nelu3d_baselines::lookup3d::Rank;

use super::mesh_format::{MeshFormat, OtherFormat};

/// Arguments of `nelu3d decode`.
#[derive(Debug, clap::Args)]
pub(crate) struct DecodeArgs {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// A name under RIG/scenes, or a folder with the same files.
    pub scene: String,
    /// Pattern set (default: the rig's first).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// Result folder to write (default: RIG/results/SCENE-SET-METHOD).
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Evaluate the finished result against the ground truth in this folder; result.json and the report have the
    /// errors.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
    /// Write the surface in these formats too.
    #[arg(long, value_name = "FORMAT", value_delimiter = ',')]
    pub mesh: Vec<MeshFormat>,
    /// Write points and depth in these formats too.
    #[arg(long, value_name = "FORMAT", value_delimiter = ',')]
    pub also: Vec<OtherFormat>,
    /// Write the result even if it is judged bad.
    #[arg(long)]
    pub accept: bool,
    /// Settings of the method.
    #[command(flatten)]
    pub options: nelu3d_baselines::DecodeOptions,
}

/// Arguments of `nelu3d projector`.
#[derive(Debug, clap::Args)]
pub(crate) struct ProjectorArgs {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// Pattern set: binary codes along x and y (default: the first such).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// File to write (default: RIG/projector.json).
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Replace the file if it exists.
    #[arg(long)]
    pub force: bool,
    /// Settings of the calibration.
    #[command(flatten)]
    pub options: nelu3d_baselines::projector::ProjectorOptions,
}

/// Arguments of `nelu3d table`.
#[derive(Debug, clap::Args)]
pub(crate) struct TableArgs {
    /// The command to run.
    #[command(subcommand)]
    pub command: TableCommand,
}

/// The commands for lookup tables.
#[derive(Debug, Subcommand)]
pub(crate) enum TableCommand {
    /// Write the table of a rig's sweep: .npy, or .npz with --low-rank.
    Export(TableExportArgs),
    /// Describe the content of a file.
    Info(TableInfoArgs),
}

/// Arguments of `nelu3d table export`.
#[derive(Debug, clap::Args)]
pub(crate) struct TableExportArgs {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// Pattern set (default: the rig's first).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// File to write.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Keep every Nth pixel and row only.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub stride: usize,
    /// Write factors with this number of terms per channel instead; "auto": as few as lose no more than the table's
    /// noise.
    #[arg(long, value_name = "R|auto", value_parser = rank)]
    pub low_rank: Option<Rank>,
}

/// Arguments of `nelu3d table info`.
#[derive(Debug, clap::Args)]
pub(crate) struct TableInfoArgs {
    /// Lookup table, .npy or .npz.
    pub file: PathBuf,
}

/// Parses the rank of a table.
fn rank(text: &str) -> Result<Rank, String> {
    match text.parse() {
        Ok(rank @ 1..) => Ok(Rank::Fixed(rank)),
        _ if text == "auto" => Ok(Rank::Auto),
        _ => Err("a number from 1, or \"auto\"".into()),
    }
}
