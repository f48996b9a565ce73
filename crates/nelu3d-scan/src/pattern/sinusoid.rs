//! A sinusoid, shifted in phase from image to image.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use super::error::{PatternError, check_period};
use crate::image::Image;

/// `½ + ½ cos 2π(u / period − i / steps)` for image i of `steps`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Sinusoid {
    /// Direction of change.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Length of a period, px.
    #[cfg_attr(feature = "clap", arg(long = "period", value_name = "PX", default_value_t = 20.0))]
    pub period_px: f64,
    /// Number of images, shifted evenly over one period.
    #[serde(default = "one")]
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 4))]
    pub steps: usize,
}

fn one() -> usize {
    1
}

impl Sinusoid {
    pub(super) fn generate(&self, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
        check_period("sinusoid", "period_px", self.period_px)?;
        if !(1..=64).contains(&self.steps) {
            let value = self.steps as f64;
            return Err(PatternError::Setting { family: "sinusoid", key: "steps", value, remedy: "give 1 to 64" });
        }
        let value = |step: usize, u: usize| {
            0.5 + 0.5 * (TAU * (u as f64 / self.period_px - step as f64 / self.steps as f64)).cos()
        };
        Ok((0..self.steps).map(|step| along(self.axis, width, height, |u| value(step, u))).collect())
    }
}
