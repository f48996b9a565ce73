//! Settings of the frames of a sequence.

use serde::{Deserialize, Serialize};

/// Ways to handle motion between a pattern and its white (flash) image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum MotionMode {
    /// The white (flash) image is drawn as it was at the pattern's time, which is found with the surface
    #[default]
    Auto,
    /// The white image is a mean of this frame's and that of the previous (or next) frame
    Interpolate,
    /// Pattern and white image are taken to show the same
    Off,
}

/// Settings of motion between a pattern and its white (flash) image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct MotionOptions {
    /// What to do about motion between a pattern and its white (flash) image
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = MotionMode::Auto))]
    pub motion: MotionMode,
    /// When patterns are taken, in frames from their white image (negative: before it). Without it, `auto` finds it and
    /// `interpolate` takes -0.5
    #[cfg_attr(feature = "clap", arg(long, value_name = "FRAMES", allow_negative_numbers = true))]
    pub pattern_time: Option<f32>,
}
