//! What a projector calibration reports.

use nelu3d::progress::StageTime;
use serde::Serialize;

use crate::response::Response;

/// How well a projector was calibrated.
#[derive(Clone, Debug, Serialize)]
pub struct ProjectorReport {
    /// The pattern set that was decoded.
    pub set: String,
    /// Board positions with corners that were used.
    pub positions: usize,
    /// Corners used.
    pub corners: usize,
    /// Corners that were rejected: too little was decoded around them, or they contradict the others.
    pub rejected: usize,
    /// Root mean square distance between a corner's decoded and computed projector pixel, px.
    pub rms_px: f64,
    /// Range of the corners' depths, mm: outside of it the calibration extrapolates.
    pub depth_mm: [f64; 2],
    /// The projector's center in the camera's frame, mm.
    pub center_mm: [f64; 3],
    /// Standard deviation of the center, from the residuals alone, mm.
    pub center_sigma_mm: [f64; 3],
    /// Light per projected value, where the sweep has images with values between black and white.
    pub response: Option<Response>,
    /// What took how long.
    pub stages: Vec<StageTime>,
}
