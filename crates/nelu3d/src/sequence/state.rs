//! What a frame leaves for the next one.

use serde::Serialize;

use super::motion::PatternTime;
use super::options::MotionOptions;
use crate::reconstruct::Diagnostics;
use crate::sensor::CrosstalkMatrix;

/// What a frame leaves for the next one.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameState {
    /// Camera z per pixel, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// When patterns were taken, if that is known.
    pub pattern_time: Option<PatternTime>,
    /// The camera's crosstalk, if it is known.
    pub crosstalk: Option<CrosstalkMatrix>,
}

/// What the reconstruction of a frame puts on record.
#[derive(Clone, Debug, Serialize)]
pub struct FrameDiagnostics {
    /// Those of the reconstruction.
    #[serde(flatten)]
    pub reconstruction: Diagnostics,
    /// What was found about motion.
    pub motion: MotionDiagnostics,
}

/// What was found about motion between a pattern and its white image.
#[derive(Clone, Debug, Serialize)]
pub struct MotionDiagnostics {
    /// What was asked for.
    pub settings: MotionOptions,
    /// Median speed of lit pixels, px per frame.
    pub speed_px: f32,
    /// When patterns were taken, if that is known: handed on to the next frame.
    pub pattern_time: Option<PatternTime>,
}
