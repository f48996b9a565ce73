//! The calibration sweep.

use serde::{Deserialize, Serialize};

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
    /// Held by hand: evenly spread in depth, each position and angle its own.
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
