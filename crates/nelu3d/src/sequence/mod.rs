//! Scenes that move: each frame is reconstructed from the previous one, with the white (flash) image as it was when the
//! pattern was taken.
//!
//! A sequence falls into stretches that begin with a keyframe, a frame that uses nothing of the previous one. Every
//! other frame depends on what the previous frame left ([`FrameState`]) and on the white images of its two neighbors,
//! and on nothing else: a stretch has the same result whether it is computed alone, in one go, or with interruptions.

mod brightness;
#[doc(hidden)]
pub mod flow;
mod frame;
mod motion;
mod neighbors;
mod options;
mod pattern_time;
mod plan;
#[doc(hidden)]
pub mod pyramid;
mod resample;
mod state;
#[doc(hidden)]
pub mod vector_map;
#[doc(hidden)]
pub mod white_blend;

pub use frame::{FrameInput, FrameReconstruction, reconstruct_frame};
pub use motion::Motion;
pub use neighbors::Neighbors;
pub use options::{MotionMode, MotionOptions};
pub use pattern_time::PatternTime;
pub use plan::{Plan, Shard};
pub use state::{FrameDiagnostics, FrameState, MotionDiagnostics};
