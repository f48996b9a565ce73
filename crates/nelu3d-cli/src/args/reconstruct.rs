//! Arguments of `reconstruct`.

use std::path::PathBuf;

use super::mesh_format::{MeshFormat, OtherFormat};

/// Arguments of `nelu3d reconstruct`.
#[derive(Debug, clap::Args)]
pub(crate) struct ReconstructArgs {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// A name under RIG/scenes, or a folder with the same files.
    pub scene: String,
    /// Pattern set (default: the rig's first).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// Color field (default: RIG/fields/SET.safetensors, as `calibrate` writes it).
    #[arg(long, value_name = "FILE")]
    pub field: Option<PathBuf>,
    /// Result folder to write (default: RIG/results/SCENE-SET).
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Evaluate the finished result against the ground truth in this folder; result.json and the report have the
    /// errors.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
    /// Record the error after every iteration against processor time in result.json.
    #[arg(long, requires = "truth")]
    pub trace: bool,
    /// Write the surface in these formats too.
    #[arg(long, value_name = "FORMAT", value_delimiter = ',')]
    pub mesh: Vec<MeshFormat>,
    /// Write points and depth in these formats too.
    #[arg(long, value_name = "FORMAT", value_delimiter = ',')]
    pub also: Vec<OtherFormat>,
    /// Correct the color field for a motion of camera or light since the sweep, as the board in view tells it.
    #[arg(long)]
    pub correct: bool,
    /// Write the result even if it is judged bad.
    #[arg(long)]
    pub accept: bool,
    /// Settings of the method.
    #[command(flatten)]
    pub options: nelu3d::ReconstructionOptions,
}
