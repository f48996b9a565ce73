//! The rig folder: everything about one camera and one light source that did not move. See `docs/capture-format.md`.

use std::path::PathBuf;

use crate::board::Board;
use crate::camera::{Camera, Projector};

/// How the sensor delivers color.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// One channel.
    Mono,
    /// Three channels a pixel.
    Rgb,
    /// A raw mosaic: the colors of the 2×2 cell at the top left, row by row (0 red, 1 green, 2 blue).
    Bayer([u8; 4]),
}

impl Channels {
    /// Channels of an image once read: 1 or 3.
    pub fn count(self) -> usize {
        if self == Channels::Mono { 1 } else { 3 }
    }
}

/// What one reconstruction uses: k images (mono) or fewer images of three channels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PatternSet {
    /// Its name.
    pub name: String,
    /// File names of the pattern images.
    pub images: Vec<String>,
    /// File names of the inverses; empty when there are none.
    pub inverse: Vec<String>,
}

/// Where the board was, when that is known without looking.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownPose {
    /// Name of the position's folder.
    pub position: String,
    /// Takes board coordinates to camera coordinates.
    pub cam_from_board: nalgebra::Isometry3<f64>,
}

/// A rig folder, opened: its description is read, its images are not.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// The folder.
    pub root: PathBuf,
    /// Free text.
    pub name: String,
    /// Camera intrinsics.
    pub camera: Camera,
    /// File name of the intrinsics, relative to the root.
    pub camera_file: String,
    /// How the sensor delivers color.
    pub channels: Channels,
    /// Sensor code for no light.
    pub black_level: f64,
    /// Sensor code at and above which a value is clipped.
    pub saturation: f64,
    /// File name of the white flash.
    pub white: String,
    /// File name of the ambient image.
    pub black: String,
    /// The pattern sets.
    pub pattern_sets: Vec<PatternSet>,
    /// The target of the sweep, when there is one.
    pub board: Option<Board>,
    /// Known board poses.
    pub poses: Vec<KnownPose>,
    /// The calibrated projector, when there is one.
    pub projector: Option<Projector>,
}

/// One folder of images taken under the same conditions: a board position, a scene or a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shot {
    /// The folder's name.
    pub name: String,
    /// The folder.
    pub dir: PathBuf,
}
