//! Arguments of `import` and `check`: rig folders.

use std::path::PathBuf;

use nelu3d_scan::image::Channels;

/// Arguments of `nelu3d import`.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("target").required(true))]
pub(crate) struct ImportArgs {
    /// Folder of numbered frames: PNG, TIFF, or uncompressed DNG as Chronos cameras record it.
    pub frames: PathBuf,
    /// Rig folder, or its rig.toml; a new one needs --camera.
    pub rig: PathBuf,
    /// Write RIG/sequences/NAME: every group of images becomes a frame.
    #[arg(long, value_name = "NAME", group = "target")]
    pub sequence: Option<String>,
    /// Write RIG/scenes/NAME: one group of images, or with --mean several.
    #[arg(long, value_name = "NAME", group = "target")]
    pub scene: Option<String>,
    /// Write RIG/calibration: every group of images becomes a board position.
    #[arg(long, group = "target")]
    pub calibration: bool,
    /// What consecutive frames are, over and over again: white, black, names of patterns, or skip for one to drop
    /// (default: the images of the pattern set, then white).
    #[arg(long, value_name = "IMAGE,…", value_delimiter = ',')]
    pub order: Option<Vec<String>>,
    /// Pattern set that the default order is of (default: the rig's first), or the name of a new rig's.
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// First frame to use, counted from 1 in the order of the names.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub first: Option<u32>,
    /// Last frame to use.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub last: Option<u32>,
    /// Use every Nth group only.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// Average all groups into one, for less noise where nothing moved.
    #[arg(long, conflicts_with = "sequence")]
    pub mean: bool,
    /// Black image (light off), for recordings without one: an image, or a folder of images to average.
    #[arg(long, value_name = "FILE|DIR")]
    pub black: Option<PathBuf>,
    /// Replace what an earlier import wrote there.
    #[arg(long)]
    pub force: bool,
    /// Settings of a new rig.
    #[command(flatten)]
    pub sensor: SensorArgs,
}

/// Settings of the camera of a new rig.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "New rigs")]
pub(crate) struct SensorArgs {
    /// Intrinsics (default: RIG/camera.json).
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Color format of the sensor: mono, rgb, bayer-rggb, bayer-bggr, bayer-grbg, bayer-gbrg (default: as DNG says).
    #[arg(long, value_name = "CHANNELS", value_parser = channels)]
    pub channels: Option<Channels>,
    /// Sensor code for no light (default: as DNG says, or 0).
    #[arg(long, value_name = "CODE", value_parser = code)]
    pub black_level: Option<f64>,
    /// Sensor code at and above which a value is saturated (default: as DNG says, or by the frames' codes).
    #[arg(long, value_name = "CODE", value_parser = code)]
    pub saturation: Option<f64>,
}

/// Parses the name of a color format.
pub(super) fn channels(text: &str) -> Result<Channels, String> {
    Channels::from_name(text).ok_or_else(|| format!("one of {}", Channels::ALL.map(Channels::name).join(", ")))
}

/// Parses a sensor code.
pub(super) fn code(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(code) if (0.0..=65535.0).contains(&code) => Ok(code),
        _ => Err("a number from 0 to 65535".into()),
    }
}

/// Arguments of `nelu3d check`.
#[derive(Debug, clap::Args)]
pub(crate) struct CheckArgs {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// Check instead whether camera or light moved since the sweep, by captures of the rig's board: names under
    /// RIG/scenes, or folders with white, black, and all patterns. A board at one of its places of the sweep tells
    /// which of the two moved; several boards tell a motion better than one.
    #[arg(long, value_name = "SCENE,…", value_delimiter = ',')]
    pub drift: Vec<String>,
    /// Pattern set of these captures (default: the rig's first).
    #[arg(long, value_name = "NAME", requires = "drift")]
    pub set: Option<String>,
    /// Color field to check (default: RIG/fields/SET.safetensors).
    #[arg(long, value_name = "FILE", requires = "drift")]
    pub field: Option<PathBuf>,
    /// Write the color field, corrected for what moved.
    #[arg(long, value_name = "FILE", requires = "drift")]
    pub correct: Option<PathBuf>,
}
