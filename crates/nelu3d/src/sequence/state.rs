//! The state that a frame leaves for the next one, and its diagnostics.

use serde::Serialize;

use super::options::MotionOptions;
use super::pattern_time::PatternTime;
use crate::reconstruct::Diagnostics;
use crate::sensor::CrosstalkMatrix;

/// The state of a sequence after a frame: all of it that the next frame starts from.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameState {
    /// Camera z per pixel, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// Time of the patterns relative to their white images, if it is known.
    pub pattern_time: Option<PatternTime>,
    /// The camera's crosstalk, if it is known.
    pub crosstalk: Option<CrosstalkMatrix>,
}

/// Diagnostics of a frame's reconstruction.
#[derive(Clone, Debug, Serialize)]
pub struct FrameDiagnostics {
    /// The diagnostics of the reconstruction.
    #[serde(flatten)]
    pub reconstruction: Diagnostics,
    /// Diagnostics of motion.
    pub motion: MotionDiagnostics,
}

/// Diagnostics of motion between a pattern and its white image.
#[derive(Clone, Debug, Serialize)]
pub struct MotionDiagnostics {
    /// The settings that were asked for.
    pub settings: MotionOptions,
    /// Median speed of lit pixels, px per frame.
    pub speed_px: f32,
    /// Time of the patterns relative to their white images, if it is known: handed on to the next frame.
    pub pattern_time: Option<PatternTime>,
}
