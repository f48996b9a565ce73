//! Structured light without a projector model: lookup, color field, reconstruction, evaluation.

pub mod evaluate;
pub mod progress;
pub mod result;

pub use progress::Progress;
pub use result::{Left, Reconstruction};
