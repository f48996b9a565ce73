//! The previous frame of a moving scene.

use crate::sensor::CrosstalkMatrix;

/// The previous frame of a moving scene, as far as the next one starts from it.
#[derive(Clone, Debug)]
pub struct PreviousFrame {
    /// Camera z per pixel, mm; NaN where there was no surface.
    pub depth: Vec<f32>,
    /// The camera's crosstalk, if it is known.
    pub crosstalk: Option<CrosstalkMatrix>,
}
