//! The calibration sweep.

use serde::{Deserialize, Serialize};

use super::defaults::{is_zero, one_hand, skin, thumb_mm};

/// Spacing of the depths of a hand-held sweep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DepthSpacing {
    /// Evenly spread, in order.
    #[default]
    Even,
    /// Anywhere in equal parts of the range, one in each, in any order.
    Scattered,
}

impl DepthSpacing {
    fn is_even(&self) -> bool {
        *self == Self::Even
    }
}

/// Hands that hold the board of a hand-held sweep: each covers a part of its edge, at another place at every position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandsSpec {
    /// Number of hands, spread evenly around the board's outline.
    #[serde(default = "one_hand")]
    pub number: usize,
    /// Reach of the thumb from the outline over the board, mm.
    #[serde(default = "thumb_mm")]
    pub size_mm: f64,
    /// Albedo of the skin: red, green, blue.
    #[serde(default = "skin")]
    pub albedo: [f64; 3],
}

/// Poses of the board in the sweep. Positions are those of the middle of the board's outline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum SweepSpec {
    /// On a linear stage: one rotation, positions on a line.
    Stage {
        /// Number of positions.
        positions: usize,
        /// Depth of the first position, mm.
        first_mm: f64,
        /// Depth of the last position, mm.
        last_mm: f64,
        /// Point where the line meets the middle of the depths, x and y, mm.
        #[serde(default)]
        center_mm: [f64; 2],
        /// Sideways motion per depth, x and y (the stage is never exactly parallel to the camera's axis).
        #[serde(default)]
        slope: [f64; 2],
        /// Rotation of the board against the camera, a Rodrigues vector; zero faces the camera.
        #[serde(default)]
        rotation: [f64; 3],
        /// Standard deviation of a position along the line, mm.
        #[serde(default)]
        step_error_mm: f64,
        /// Standard deviation of the board's wobble about each axis, anew at each position, radians.
        #[serde(default)]
        tilt_jitter: f64,
        /// Whether rig.toml tells the poses.
        #[serde(default)]
        write_poses: bool,
    },
    /// Held by hand: spread in depth, each position and angle its own. A pose that breaks `max_tilt` or `min_in_view` is
    /// drawn again.
    Handheld {
        /// Number of positions.
        positions: usize,
        /// Depth of the nearest position, mm.
        first_mm: f64,
        /// Depth of the farthest position, mm.
        last_mm: f64,
        /// Middle of the positions, x and y, mm.
        #[serde(default)]
        center_mm: [f64; 2],
        /// Standard deviation of the position in x, y and z, mm.
        position_sigma_mm: f64,
        /// Standard deviation of the tilt about each axis, radians.
        tilt_sigma: f64,
        /// Spacing of the depths between `first_mm` and `last_mm`.
        #[serde(default, skip_serializing_if = "DepthSpacing::is_even")]
        depths: DepthSpacing,
        /// Largest angle between the board's normal and the camera's axis, radians; none: any.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        max_tilt: Option<f64>,
        /// Fraction of the board's area that is at least within the picture, 0 to 1. With 0 nothing is asked.
        #[serde(default, skip_serializing_if = "is_zero")]
        min_in_view: f64,
        /// Hands that hold the board and cover parts of its edge; none: nothing covers it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        hands: Option<HandsSpec>,
        /// Whether rig.toml tells the poses.
        #[serde(default)]
        write_poses: bool,
    },
}

impl SweepSpec {
    /// Returns the number of positions.
    pub fn positions(&self) -> usize {
        match self {
            SweepSpec::Stage { positions, .. } | SweepSpec::Handheld { positions, .. } => *positions,
        }
    }

    /// Whether rig.toml tells the poses.
    pub fn write_poses(&self) -> bool {
        match self {
            SweepSpec::Stage { write_poses, .. } | SweepSpec::Handheld { write_poses, .. } => *write_poses,
        }
    }
}
