//! The rig folder: everything about one camera and one light source that did not move. See `docs/capture-format.md`.

mod capture;
mod check;
mod error;
mod file;
mod memory;
mod mono;
mod mosaic;
mod names;
mod shots;

use std::path::{Path, PathBuf};

pub use capture::{Capture, ImageCodes, Need, ShotReader, What};
pub use check::{Finding, Severity, check};
pub use error::RigError;
pub use file::{board_lines, read_board, state_response};
pub use memory::{MemoryImages, StoredImage};
pub use mono::{LUMA, luma, spread_mono};
pub use mosaic::pattern_of_mosaic;
pub use names::{NAME_RULE, is_file_name, is_name};
pub use shots::natural_order;

use crate::board::Board;
use crate::camera::{Camera, Projector};
pub use crate::image::{Channels, Response};

/// What one reconstruction uses: k images (mono) or fewer images of three channels. Among the images of an `rgb` camera
/// some may be mono: see [`Capture::mono`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PatternSet {
    /// Its name.
    pub name: String,
    /// File names of the pattern images.
    pub images: Vec<String>,
    /// File names of the inverses; empty when there are none.
    pub inverse: Vec<String>,
}

/// The pose of the board at a position, known without detecting the board.
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
    /// How codes follow light, where rig.toml says it; else they are proportional to it, and JPEG files are refused.
    pub response: Option<Response>,
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
    /// Images in memory; where there are some, no image is read from a file.
    pub memory: Option<MemoryImages>,
}

/// One folder of images taken under the same conditions: a board position, a scene or a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shot {
    /// The folder's name.
    pub name: String,
    /// The folder.
    pub dir: PathBuf,
}

/// The description of a rig folder.
pub const RIG_FILE: &str = "rig.toml";
/// The calibrated projector, where there is one.
pub const PROJECTOR_FILE: &str = "projector.json";

impl Rig {
    /// Returns the pattern set of this name; without a name the first (usually the only) one.
    ///
    /// # Errors
    ///
    /// There is no such set; the message lists those there are.
    pub fn pattern_set(&self, name: Option<&str>) -> Result<&PatternSet, RigError> {
        let found = match name {
            Some(name) => self.pattern_sets.iter().find(|s| s.name == name),
            None => self.pattern_sets.first(),
        };
        found.ok_or_else(|| RigError::NoPatternSet {
            path: self.root.join(RIG_FILE),
            name: name.map(str::to_owned),
            known: self.pattern_sets.iter().map(|s| s.name.clone()).collect(),
        })
    }

    /// Returns the k of a pattern set: values per pixel, images × channels.
    pub fn channels_of(&self, set: &PatternSet) -> usize {
        set.images.len() * self.channels.count()
    }

    /// Returns where the projected form of a pattern is, if the rig keeps it. The file may be absent.
    pub fn projected(&self, pattern: &str) -> PathBuf {
        self.root.join("patterns").join(pattern)
    }

    /// Returns whether the image of a shot is there, as a file or in memory.
    pub fn has_image(&self, path: &Path) -> bool {
        match &self.memory {
            Some(memory) => memory.get(path).is_some(),
            None => path.exists(),
        }
    }

    /// Returns the pose of the board at a position, if it is known without detecting the board.
    pub fn known_pose(&self, position: &str) -> Option<&nalgebra::Isometry3<f64>> {
        self.poses.iter().find(|p| p.position == position).map(|p| &p.cam_from_board)
    }
}
