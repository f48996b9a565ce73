//! The sensor and its measurements: noise, dark level, crosstalk, and normalized captures.
//!
//! The facts are stored with a color field; the stages that estimate them (`calibrate`, `reconstruct`) lie above.

mod blur;
mod compression;
mod crosstalk;
mod dark_level;
mod intensities;
mod measurements;
mod noise;
mod other_pattern;
mod scene_faults;

pub use blur::Blur;
pub use compression::BlockDetector;
pub use crosstalk::{CrosstalkCorrection, CrosstalkMatrix, relative_white};
pub use dark_level::{DarkEstimator, DarkLevel};
pub use intensities::Intensities;
pub use measurements::Measurements;
pub use noise::{NoiseEstimator, NoiseModel, darkest_intensity, estimate_scene_noise, quantization_step};
pub use other_pattern::{PatternStatistics, edges, judge_patterns};
pub use scene_faults::{
    CodewordStatistics, Support, SurfaceEvidence, judge_capture, judge_clipping, judge_codewords, judge_explained,
};
