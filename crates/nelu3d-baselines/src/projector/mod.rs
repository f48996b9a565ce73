//! Calibrating the projector from the rig's own sweep, when its positions have binary-coded images along x and y.
//!
//! Moreno & Taubin, "Simple, Accurate, and Robust Projector-Camera Calibration" (3DIMPVT 2012): at every corner of the
//! board the decoded pixels around it give a local homography from the camera to the projector, which carries the
//! corner, found to sub-pixel in the white image, to sub-pixel into the projected image. Decoding errors average out,
//! and no pixel of the projector needs to be seen.
//!
//! The rest differs from the paper: there, the projector is calibrated with Zhang's method from views of a plane at
//! several angles, which a board that only slides along a stage does not give. Here the camera is calibrated already,
//! so the corners are known in its frame: a direct linear transform from them to the projected image starts a robust
//! refinement of intrinsics, distortion and pose. It needs several depths, not several angles.

mod calibrate;
mod coded_set;
mod corners;
mod direct;
mod error;
mod file;
mod fit;
pub mod measure_response;
mod options;
mod report;
mod sample;

pub use crate::response::Response;
pub use calibrate::calibrate_projector;
pub use direct::rq;
pub use error::ProjectorError;
pub(crate) use file::read_response;
pub use file::write;
pub use fit::{Fitted, fit};
pub use options::{Lens, ProjectorOptions};
pub use report::ProjectorReport;
pub use sample::Sample;
