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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_value_is_the_column() {
        let image = &Ramp { axis: Axis::X }.generate(641, 2)[0];
        for u in 0..641 {
            assert!((image.pixel(u, 1)[0] * 640.0 - u as f32).abs() < 1e-3);
        }
        assert_eq!(Ramp { axis: Axis::Y }.generate(2, 5)[0].pixel(1, 4), [1.0]);
    }
}
