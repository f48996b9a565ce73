//! What the camera saw of the board.

use crate::board::Corner;

/// The corners of the board in one image.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Name of the image, for messages.
    pub name: String,
    /// Its place in the sweep, from 0: with a stage of known step, where along the line it was taken.
    pub number: usize,
    /// The corners found.
    pub corners: Vec<Corner>,
}
