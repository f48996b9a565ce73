//! Scenes that move: each frame from the one before, and the white (flash) image as it was when the pattern was taken.
//!
//! A sequence falls into stretches that begin with a keyframe, a frame that knows nothing of the one before. Every other
//! frame depends on what the frame before it left ([`FrameState`]) and on the white images of its two neighbors, and on
//! nothing else: a stretch gives the same whether it is computed alone, in one go, or with interruptions.

mod flow;
mod frame;
mod motion;
mod neighbors;
mod options;
mod plan;
mod state;

pub use frame::{FrameInput, FrameReconstruction, reconstruct_frame};
pub use motion::{Motion, PatternTime};
pub use neighbors::Neighbors;
pub use options::{MotionMode, MotionOptions};
pub use plan::{Plan, Shard};
pub use state::{FrameDiagnostics, FrameState, MotionDiagnostics};
