//! One ramp from dark to bright: unambiguous and insensitive.

use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use crate::image::Image;

/// 0 at the first pixel, 1 at the last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Ramp {
    /// Direction of change.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
}

impl Ramp {
    pub(super) fn generate(&self, width: usize, height: usize) -> Vec<Image> {
        let last = (self.axis.length(width, height) - 1).max(1) as f64;
        vec![along(self.axis, width, height, |u| u as f64 / last)]
    }
}
