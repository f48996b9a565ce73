//! A triangle wave: constant slopes, so equally sensitive everywhere but at its tips.

use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use super::error::{PatternError, check_period};
use crate::image::Image;

/// 0 at the first pixel, 1 half a period later, 0 a period later.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Triangle {
    /// Direction of change.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Length of a period, px.
    #[cfg_attr(feature = "clap", arg(long = "period", value_name = "PX", default_value_t = 200.0))]
    pub period_px: f64,
}

impl Triangle {
    pub(super) fn generate(&self, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
        check_period("triangle", "period_px", self.period_px)?;
        let value = |u: usize| 1.0 - (2.0 * (u as f64 / self.period_px).fract() - 1.0).abs();
        Ok(vec![along(self.axis, width, height, value)])
    }
}
