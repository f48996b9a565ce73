//! The whole spec: scanner, board, sweep, scenes and sequences.

use nelu3d_scan::pattern::Pattern;
use serde::{Deserialize, Serialize};

use super::board::{BoardBendSpec, BoardCurlSpec, BoardSpec};
use super::camera::CameraSpec;
use super::interreflection::InterreflectionSpec;
use super::light::LightSpec;
use super::scene::SceneSpec;
use super::sequence::SequenceSpec;
use super::sweep::SweepSpec;

/// A virtual scanner and everything it captures. Lengths in mm, angles in radians, the camera's frame is the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Free text, the rig's name.
    pub name: String,
    /// Seed of everything random: noise, pixel sampling, jitter of the sweep. The same seed gives the same bytes.
    #[serde(default)]
    pub seed: u64,
    /// Rays per pixel are the square of this; 1 to 16.
    #[serde(default = "supersampling")]
    pub supersampling: usize,
    /// Irradiance of the light that does not come from the light source, in units of the flash's at its reference
    /// distance. It falls on every surface alike and casts no shadow.
    #[serde(default)]
    pub ambient: f64,
    /// Interreflection; off where it is not given.
    #[serde(default = "no_interreflection")]
    pub interreflection: InterreflectionSpec,
    /// The camera.
    pub camera: CameraSpec,
    /// The light source.
    pub light: LightSpec,
    /// Pattern sets that a projector shows; none for film, which has its own pattern.
    #[serde(default)]
    pub pattern_sets: Vec<PatternSetSpec>,
    /// The board of the calibration sweep.
    pub board: BoardSpec,
    /// Albedo of the board's ink and of its paper. Gray ink still shows the pattern, black ink hardly does.
    #[serde(default = "ink_and_paper")]
    pub board_albedo: [f64; 2],
    /// Resolution of the printer that made the board, dots per inch; none: edges are exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub print_dpi: Option<f64>,
    /// Bend of the physical board; none: it is flat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board_bend: Option<BoardBendSpec>,
    /// Curled corner of the physical board; none: it lies flat, or on the bend.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board_curl: Option<BoardCurlSpec>,
    /// Poses of the board in the calibration sweep.
    pub sweep: SweepSpec,
    /// The scenes to scan.
    #[serde(default)]
    pub scenes: Vec<SceneSpec>,
    /// The moving scenes to scan.
    #[serde(default)]
    pub sequences: Vec<SequenceSpec>,
}

fn ink_and_paper() -> [f64; 2] {
    [0.04, 0.85]
}

fn no_interreflection() -> InterreflectionSpec {
    InterreflectionSpec::OFF
}

fn supersampling() -> usize {
    4
}

/// A pattern set of the rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PatternSetSpec {
    /// Its name.
    pub name: String,
    /// Its patterns. Images are numbered by family through all sets; equal images are captured once and shared.
    pub patterns: Vec<Pattern>,
}
