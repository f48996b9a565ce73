//! What a calibration found.

use nelu3d_scan::pose::Trajectory;
use serde::Serialize;

use crate::color_field::Quality;
use crate::progress::StageTime;

/// What a calibration found.
#[derive(Clone, Debug, Serialize)]
pub struct CalibrationReport {
    /// The poses, position by position; none for a field from the projector.
    pub trajectory: Option<Trajectory>,
    /// Where the light is, camera frame, mm; none for parallel light.
    pub light_mm: Option<[f64; 3]>,
    /// How well the field predicts what it has not seen.
    pub quality: Option<Quality>,
    /// Where the frame is centered, and why.
    pub frame: String,
    /// Why the field stays more than 3 dB below what noise allows, if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shortfall: Option<String>,
    /// Cells of the field along a, b and w.
    pub cells: [usize; 3],
    /// What took how long.
    pub stages: Vec<StageTime>,
}
