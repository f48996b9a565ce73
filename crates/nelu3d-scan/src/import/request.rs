//! What is to be imported, and how.

use std::path::PathBuf;

use crate::image::Channels;

/// What a recording becomes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ImportTarget {
    /// `sequences/NAME`: every group is a frame, `0000`, `0001`, ….
    Sequence(String),
    /// `scenes/NAME`: one group.
    Scene(String),
    /// `calibration`: every group is a board position.
    Calibration,
}

/// What to import, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportRequest {
    /// The folder of frames.
    pub frames: PathBuf,
    /// The rig: its folder or rig.toml, or the folder of a new one.
    pub rig: PathBuf,
    /// What the frames become.
    pub target: ImportTarget,
    /// What consecutive frames are: names of the rig's images with or without ending, or `skip`. Over and over again.
    /// `None`: the images of the pattern set, then white.
    pub order: Option<Vec<String>>,
    /// The pattern set that `order` stands for by default, or the name of a new rig's. `None`: the first; `recorded`.
    pub set: Option<String>,
    /// The first frame to use, from 1.
    pub first: Option<usize>,
    /// The last frame to use.
    pub last: Option<usize>,
    /// Use every so many groups only, at least 1.
    pub every: usize,
    /// Average all groups into one.
    pub mean: bool,
    /// The light off for every group: an image, or a folder of images to average.
    pub black: Option<PathBuf>,
    /// Intrinsics of a new rig. `None`: its camera.json is already there.
    pub camera: Option<PathBuf>,
    /// How the sensor of a new rig delivers color. `None`: as the files say.
    pub channels: Option<Channels>,
    /// Sensor code for no light of a new rig. `None`: as the files say.
    pub black_level: Option<f64>,
    /// Sensor code at which a new rig's values are clipped. `None`: as the files or their codes say.
    pub saturation: Option<f64>,
    /// Replace what an earlier import left.
    pub force: bool,
}
