//! Arguments of `evaluate` and `experiment`.

use std::path::PathBuf;

use nelu3d_evaluate::cad::CadOptions;
use nelu3d_field::device::Choice;

/// Arguments of `nelu3d evaluate`.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("reference").required(true))]
pub(crate) struct EvaluateArgs {
    /// Result folder to evaluate.
    pub result: PathBuf,
    /// Folder of the ground truth: depth.npy and mask.png.
    #[arg(long, value_name = "DIR", group = "reference")]
    pub truth: Option<PathBuf>,
    /// Another result of the same camera.
    #[arg(long, value_name = "RESULT", group = "reference")]
    pub against: Option<PathBuf>,
    /// CAD mesh of the part, which is aligned to the scan: .ply, .obj or .stl, mm, anywhere in space.
    #[arg(long, value_name = "MESH", group = "reference")]
    pub cad: Option<PathBuf>,
    /// Millimeters per unit of the mesh: 1000 for meters, 25.4 for inches.
    #[arg(
        long,
        value_name = "S",
        default_value_t = CadOptions::default().scale,
        requires = "cad",
        value_parser = positive
    )]
    pub scale: f64,
    /// Approximate pose of the mesh: cam_from_cad of an alignment.json, or sixteen numbers row by row, mm.
    #[arg(long, value_name = "FILE", requires = "cad")]
    pub initial_pose: Option<PathBuf>,
    /// Leave the mesh where it is: in the camera's frame, or where --initial-pose puts it.
    #[arg(long, requires = "cad")]
    pub no_align: bool,
    /// Distance from the mesh within which a point belongs to the part, mm (default: 1 % of the mesh's diagonal).
    #[arg(long, value_name = "MM", requires = "cad", value_parser = positive)]
    pub within: Option<f64>,
    /// Folder to write: distances, histogram, colored surface, report.
    #[arg(short, long, value_name = "DIR", conflicts_with = "truth")]
    pub output: Option<PathBuf>,
    /// Calibrated projector, in whose columns errors are measured, too.
    #[arg(long, value_name = "FILE", conflicts_with = "rig")]
    pub projector: Option<PathBuf>,
    /// Rig folder whose projector is used for that.
    #[arg(long, value_name = "RIG")]
    pub rig: Option<PathBuf>,
}

/// Parses a positive number.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if (1e-9..=1e9).contains(&v) => Ok(v),
        _ => Err("a number above 0".into()),
    }
}

/// Arguments of `nelu3d experiment`.
#[derive(Debug, clap::Args)]
pub(crate) struct ExperimentArgs {
    /// An experiment that comes with the program, or a file that describes one (.toml); none lists them.
    #[arg(value_name = "NAME|FILE.toml")]
    pub name: Option<String>,
    /// Folder for rigs, results, tables and pages. What an earlier run left there is not computed again.
    #[arg(short, long, value_name = "DIR", default_value = "nelu3d-experiments")]
    pub output: PathBuf,
    /// Run a small version, in a minute or so, to see that it works; its numbers mean nothing.
    #[arg(long)]
    pub quick: bool,
    /// Where calibrations, reconstructions and sequences do their heavy work: auto, cpu, gpu, or gpu:N as in
    /// `nelu3d devices`.
    #[arg(long, default_value_t)]
    pub device: Choice,
    /// Seeds instead of the experiment's own.
    #[arg(long, value_name = "N", value_delimiter = ',', num_args = 1..)]
    pub seeds: Option<Vec<u64>>,
    /// Reuse results that another build of this program left there, too.
    #[arg(long)]
    pub reuse: bool,
}
