//! Why a capture fails.

use std::path::PathBuf;

use nelu3d_scan::image::ImageFileError;
use nelu3d_scan::rig::RigError;

/// Why a capture fails: what went wrong, and what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The flashes cannot be seen.
    #[error(
        "the camera does not see the light source: white is {white:.1} and black {black:.1} of {full:.0} codes on \
         average; point both at the same place, remove the lens cap, darken the room, or lengthen the exposure"
    )]
    NoLight {
        /// Mean code under white.
        white: f64,
        /// Mean code under black.
        black: f64,
        /// Largest code.
        full: f64,
    },
    /// Brightness follows the picture.
    #[error(
        "the camera's exposure is not locked: under the same {slide} its brightness went from {before:.1} to \
         {after:.1} codes; switch automatic exposure, gain and white balance off"
    )]
    ExposureNotLocked {
        /// What was shown.
        slide: &'static str,
        /// Mean code at first.
        before: f64,
        /// Mean code later.
        after: f64,
    },
    /// Frames never come to rest.
    #[error(
        "the picture does not come to rest: of {frames} frames no two agreed; fix camera, light source and board, or \
         choose an exposure that is a whole multiple of the display's refresh and of the lamps' flicker"
    )]
    Unsteady {
        /// Frames looked at.
        frames: usize,
    },
    /// Something moved while the images were taken.
    #[error(
        "something moved or changed its brightness while the images were taken: {percent:.1} % of the picture differ \
         between the first and the last white image; hold still, and take this position again"
    )]
    Moved {
        /// Part of the picture that differs, percent.
        percent: f64,
    },
    /// The camera's picture changed its size or depth.
    #[error("the camera's frames changed from {before} to {after}; keep its settings as they are during a capture")]
    OtherFrames {
        /// Size, channels and depth before.
        before: String,
        /// Size, channels and depth now.
        after: String,
    },
    /// The camera or the light source is gone.
    #[error("{device}: {problem}; {remedy}")]
    Device {
        /// Which.
        device: String,
        /// What happened.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// The capture was stopped by the person who had started it.
    #[error("the capture was stopped")]
    Stopped,
    /// A file of the rig is not what a capture can go on with.
    #[error("{}: {problem}; {remedy}", path.display())]
    Unfit {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// The rig cannot be read or written.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// An image cannot be read.
    #[error(transparent)]
    Image(#[from] ImageFileError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] std::io::Error),
}
