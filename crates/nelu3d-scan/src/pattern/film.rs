//! A strip of color film (or a print on transparency): three dyes, one image, no pixels once it is developed.

use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use super::error::{PatternError, check_period};
use crate::image::Image;

/// One RGB image whose values are the film's transmittances in red, green and blue light, that is, linear in light.
///
/// Each dye absorbs one of them: cyan falls steadily from one end to the other, so that far places are not alike;
/// magenta and yellow are sinusoids in transmittance, coarse and fine, which tell places apart finely. Optical density
/// is −log₁₀ transmittance; all values lie between the two densities that film can hold. Dyes also absorb some of each
/// other's light, which is no harm: what the film really shows is what calibration measures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Film {
    /// Direction of change.
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Period in green light, px.
    #[cfg_attr(feature = "clap", arg(long = "coarse", value_name = "PX", default_value_t = 240.0))]
    pub coarse_px: f64,
    /// Period in blue light, px.
    #[cfg_attr(feature = "clap", arg(long = "fine", value_name = "PX", default_value_t = 60.0))]
    pub fine_px: f64,
    /// Smallest optical density: that of the film's base.
    #[cfg_attr(feature = "clap", arg(long, value_name = "D", default_value_t = 0.05))]
    pub min_density: f64,
    /// Largest optical density.
    #[cfg_attr(feature = "clap", arg(long, value_name = "D", default_value_t = 2.0))]
    pub max_density: f64,
}

impl Default for Film {
    fn default() -> Self {
        Self { axis: Axis::X, coarse_px: 240.0, fine_px: 60.0, min_density: 0.05, max_density: 2.0 }
    }
}

impl Film {
    pub(super) fn generate(&self, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
        check_period("film", "coarse_px", self.coarse_px)?;
        check_period("film", "fine_px", self.fine_px)?;
        let wrong = |key, value, remedy| PatternError::Setting { family: "film", key, value, remedy };
        if !(0.0..=5.0).contains(&self.min_density) {
            return Err(wrong("min_density", self.min_density, "give 0 to 5"));
        }
        if !(self.min_density + 0.01..=6.0).contains(&self.max_density) {
            return Err(wrong("max_density", self.max_density, "give more than min_density, at most 6"));
        }
        let (dark, bright) = (10_f64.powf(-self.max_density), 10_f64.powf(-self.min_density));
        let last = (self.axis.length(width, height) - 1).max(1) as f64;
        let wave = |u: usize, period: f64| 0.5 - 0.5 * (std::f64::consts::TAU * u as f64 / period).cos();
        let colors: [&dyn Fn(usize) -> f64; 3] =
            [&|u| u as f64 / last, &|u| wave(u, self.coarse_px), &|u| wave(u, self.fine_px)];
        let parts = colors.map(|shape| along(self.axis, width, height, |u| dark + (bright - dark) * shape(u)));
        let data = (0..width * height).flat_map(|p| [0, 1, 2].map(|c| parts[c].data[p])).collect();
        Ok(vec![Image { width, height, channels: 3, data }])
    }
}
