//! Arguments of `camera`.

use std::path::PathBuf;

use nelu3d_scan::intrinsics::LensModel;

use super::parse_code;

/// Arguments of `nelu3d camera`.
#[derive(Debug, clap::Args)]
pub(crate) struct CameraArgs {
    /// Rig folder, or its rig.toml, whose sweep (its white images) is used; or a folder of images of a board.
    pub source: PathBuf,
    /// The board, for a folder of images: a file with a table [board], as `nelu3d board` prints it (default: the rig's).
    #[arg(long, value_name = "FILE")]
    pub board: Option<PathBuf>,
    /// Coefficients of OpenCV's lens distortion: 0, 4, 5 or 8; "auto": as many as images that are left out support.
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = model)]
    pub model: ModelChoice,
    /// A stage moved the board in steps of this length, in the order of the names, mm: its step fixes the scale.
    #[arg(long, value_name = "MM", value_parser = length)]
    pub step: Option<f64>,
    /// Standard deviation of the stage's positions, mm.
    #[arg(long, value_name = "MM", default_value_t = 0.05, value_parser = length, requires = "step")]
    pub step_sigma: f64,
    /// Write a camera although its focal length or principal point is uncertain; the answer says so.
    #[arg(long)]
    pub keep_uncertain: bool,
    /// Do without this image or position; may be given several times.
    #[arg(long, value_name = "NAME")]
    pub leave_out: Vec<String>,
    /// File to write (default: the rig's, or camera.json).
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write the corners that were found, too (.json), those of images that are left out included.
    #[arg(long, value_name = "FILE")]
    pub corners: Option<PathBuf>,
    /// Replace files that exist, and what rig.toml says of the response.
    #[arg(long)]
    pub force: bool,
    /// Settings of the response.
    #[command(flatten)]
    pub response: ResponseArgs,
}

/// Measuring how codes follow light.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Response")]
pub(crate) struct ResponseArgs {
    /// Measure how codes follow light, not the lens: from a rig's folder `response`, which `nelu3d capture --response
    /// measure` fills; from its sweep's two-valued images and their inverses; or from a folder with the captures of
    /// `nelu3d patterns superposition` and black. A rig gets the curve.
    #[arg(id = "response", long = "response", conflicts_with_all = ["board", "step", "leave_out", "corners", "keep_uncertain"])]
    pub measure: bool,
    /// Exposure times of the images of a still scene, in the order of their names, as 1/60,1/30,1/15: the response is
    /// measured from those, in the folder, or in a rig's folder `response`.
    #[arg(long, value_name = "SECS", value_delimiter = ',', value_parser = secs, requires = "response")]
    pub exposures: Option<Vec<f64>>,
    /// The code for no light, for a folder that is no rig.
    #[arg(long, value_name = "CODE", value_parser = parse_code, default_value_t = 0.0, requires = "response")]
    pub black_level: f64,
    /// The code at and above which a value is saturated, for a folder that is no rig (default: the files' largest).
    #[arg(long, value_name = "CODE", value_parser = parse_code, requires = "response")]
    pub saturation: Option<f64>,
}

/// The lens model that was asked for; none: to be chosen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ModelChoice(pub(crate) Option<LensModel>);

/// Parses the number of coefficients.
fn model(text: &str) -> Result<ModelChoice, String> {
    if text == "auto" {
        return Ok(ModelChoice(None));
    }
    let found = LensModel::ALL.into_iter().find(|m| m.coefficients().to_string() == text);
    found.map(|m| ModelChoice(Some(m))).ok_or_else(|| "auto, 0, 4, 5 or 8".into())
}

/// Parses a length in mm.
fn length(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(mm) if (1e-4..=10_000.0).contains(&mm) => Ok(mm),
        _ => Err("a length in mm, from 0.0001 to 10000".into()),
    }
}

/// Parses an exposure time, a number or a fraction, s.
fn secs(text: &str) -> Result<f64, String> {
    let (above, below) = text.split_once('/').unwrap_or((text, "1"));
    match (above.trim().parse::<f64>(), below.trim().parse::<f64>()) {
        (Ok(a), Ok(b)) if a > 0.0 && b > 0.0 && (1e-9..=1e6).contains(&(a / b)) => Ok(a / b),
        _ => Err("a time in seconds, as 0.02 or 1/50".into()),
    }
}
