//! Structured light without a projector model: lookup, color field, reconstruction, evaluation.

pub mod calibrate;
pub mod color_field;
pub mod evaluate;
pub mod progress;
pub mod reconstruct;
pub mod result;

pub use progress::Progress;
pub use result::{Left, Reconstruction};
