//! What the projector is fitted to.

use nalgebra::Point3;

/// A corner of a board in the camera's frame and in the projected image.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Camera frame, mm.
    pub point: Point3<f64>,
    /// Projector px.
    pub px: [f64; 2],
}
