//! What looks.

use crate::error::CaptureError;
use crate::frame::Frame;

/// How frames come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraPace {
    /// By themselves, many a second.
    Streaming,
    /// By themselves, seconds apart.
    Sparse,
    /// One whenever asked for, exposed after that: a still camera.
    OnRequest,
}

/// A camera with everything fixed: exposure, gain, focus, white balance.
pub trait Camera {
    /// Waits for the next frame.
    ///
    /// # Errors
    ///
    /// The camera is gone, delivers nothing, or what it delivers is no image.
    fn next_frame(&mut self) -> Result<Frame, CaptureError>;

    /// Says how frames come.
    fn pace(&self) -> CameraPace {
        CameraPace::Streaming
    }
}
