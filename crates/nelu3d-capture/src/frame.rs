//! One picture of the camera.

use std::time::Duration;

use nelu3d_scan::image::Raw;

/// A picture as the camera delivered it.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Counts what was delivered, from 0.
    pub number: u64,
    /// When it arrived, on the clock that [`crate::Display::show`] answers with.
    pub at: Duration,
    /// The sensor's codes, `height × width × channels`.
    pub raw: Raw,
}
