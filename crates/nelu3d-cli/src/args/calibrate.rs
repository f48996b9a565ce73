//! Arguments of `calibrate`.

use std::path::PathBuf;

/// Arguments of `nelu3d calibrate`.
#[derive(Debug, clap::Args)]
pub(crate) struct CalibrateArgs {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// Pattern set (default: the rig's first).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// Field to write (default: RIG/fields/SET.safetensors).
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Measure the crosstalk of a color camera on this scene, of which some must be saturated in color, and store it in
    /// the field: it need not be estimated from scenes with little color then.
    #[arg(long, value_name = "SCENE")]
    pub colors: Option<String>,
    /// Compute the field from the calibrated projector and the projected images; of a sweep, or else of scenes, it
    /// takes the projector's blur and response
    #[arg(long)]
    pub from_projector: bool,
    /// Settings of a field from the projector.
    #[command(flatten)]
    pub projector: nelu3d::from_projector::FromProjectorOptions,
    /// Write the field even if it is judged bad.
    #[arg(long)]
    pub accept: bool,
    /// Settings of the method.
    #[command(flatten)]
    pub options: nelu3d::CalibrationOptions,
}
