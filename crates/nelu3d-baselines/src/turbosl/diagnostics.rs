//! What TurboSL puts on record.

use nelu3d::reconstruct::neural::TrainingRecord;
use serde::Serialize;

use super::blur::TAPS;

/// What TurboSL puts on record of one training.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TurboSlDiagnostics {
    /// Losses and counts of every hundredth iteration and of the last.
    pub losses: Vec<TrainingRecord>,
    /// Millimeters per unit of the signed distance field's cube.
    pub unit_mm: f64,
    /// The learned blur of the projected images.
    pub blur: ProjectorBlur,
}

/// The learned blur of the projected images: the kernel of each axis, from left to right or from top to bottom.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ProjectorBlur {
    /// Along x.
    pub x: [f32; TAPS],
    /// Along y.
    pub y: [f32; TAPS],
}
