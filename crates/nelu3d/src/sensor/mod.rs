//! The sensor and its measurements: noise, dark level, crosstalk, and normalized captures.
//!
//! The facts are stored with a color field; the stages that estimate them (`calibrate`, `reconstruct`) lie above.

mod crosstalk;
mod dark_level;
mod measurements;
mod noise;

pub use crosstalk::{CrosstalkCorrection, CrosstalkMatrix, relative_white};
pub use dark_level::{DarkEstimator, DarkLevel};
pub use measurements::Measurements;
pub use noise::{NoiseEstimator, NoiseModel, estimate_scene_noise, quantization_step};
