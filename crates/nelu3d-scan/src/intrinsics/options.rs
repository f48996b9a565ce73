//! What is known beforehand.

use super::lens::LensModel;

/// Settings of a camera calibration.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct IntrinsicsOptions {
    /// Number of distortion coefficients; `None`: as many as held-out images support.
    pub model: Option<LensModel>,
    /// The stage that moved the board, if one did.
    pub stage: Option<StageStep>,
    /// Whether a camera is a result although its focal length or principal point is uncertain; its report says so.
    pub keep_uncertain: bool,
}

/// A stage that moved the board along a line in equal steps, in the order of the images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageStep {
    /// Length of a step, mm.
    pub step_mm: f64,
    /// Standard deviation of a position, mm.
    pub sigma_mm: f64,
}
