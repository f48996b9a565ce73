//! From a camera and a light source to a rig folder.
//!
//! ```text
//! Display (shows slides, says when) ─┐
//!                                    ├─► CaptureSession: timing by flashes ─► slide after slide ─► SlideImages
//! Camera (frames, as they come) ─────┘                                                                  │
//!                                                              rig folder, whole or absent ◄─ RigWriter ┘
//! ```
//!
//! Nothing here sleeps and hopes. A display's word that it shows an image says little about when a camera will deliver
//! that image: frames wait in buffers, come late, twice, torn or not at all. So the images themselves decide. Flashes
//! tell how long a change takes to be seen ([`CaptureTiming`]); a frame counts when it came after that, differs from
//! all that this folder of images has shown before, and a second one agrees with it to within the measured noise
//! ([`FrameNoise`]).
//!
//! What is behind [`Display`] and [`Camera`] is somebody else's: a page in a browser, a program to run, a folder to
//! watch, or [`simulated`] ones that do everything wrong that real ones do.
//!
//! A file imports only from above it here: `error`, `frame`, `display`, `camera`; `samples`, `noise`; `exposure`,
//! `timing`; `acquire`, `session`; `rig_writer`; `guide`; `files`, `genicam`, `page`, `simulated`.

mod acquire;
mod camera;
mod display;
mod error;
mod exposure;
mod files;
mod frame;
#[cfg(any(feature = "gige", feature = "usb3"))]
mod genicam;
mod guide;
mod noise;
pub mod page;
mod rig_writer;
mod samples;
mod session;
pub mod simulated;
mod timing;

pub use acquire::FrameCounts;
pub use camera::{Camera, CameraPace};
pub use display::{Display, Slide};
pub use error::CaptureError;
pub use exposure::{ExposureAdvice, ExposureVerdict};
pub use files::{CommandCamera, WatchedFolder};
pub use frame::Frame;
#[cfg(any(feature = "gige", feature = "usb3"))]
pub use genicam::CameraSettings;
#[cfg(feature = "gige")]
pub use genicam::GigeCamera;
#[cfg(feature = "usb3")]
pub use genicam::Usb3Camera;
pub use guide::{BoardView, Coverage, SweepGuide};
pub use noise::FrameNoise;
pub use rig_writer::{NewRig, RigWriter, ShotPlace};
pub use session::{CaptureSession, SlideImages};
pub use timing::CaptureTiming;
