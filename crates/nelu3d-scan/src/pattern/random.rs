//! Smooth noise of a limited band: no two neighborhoods alike, and nothing finer than the optics can show.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use super::error::{PatternError, check_period};
use super::noise::SplitMix;
use crate::image::Image;

/// A sum of cosines with random phases whose frequencies fill the band evenly, stretched to `[0, 1]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Random {
    /// Direction of change.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Shortest period in it, px.
    #[cfg_attr(feature = "clap", arg(long = "min-period", value_name = "PX", default_value_t = 40.0))]
    pub min_period_px: f64,
    /// Longest period in it, px.
    #[cfg_attr(feature = "clap", arg(long = "max-period", value_name = "PX", default_value_t = 320.0))]
    pub max_period_px: f64,
    /// Seed; the same seed gives the same pattern.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 0))]
    pub seed: u64,
}

/// Cosines in the sum.
const N_WAVES: usize = 32;

impl Random {
    pub(super) fn generate(&self, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
        check_period("random", "min_period_px", self.min_period_px)?;
        check_period("random", "max_period_px", self.max_period_px)?;
        if self.max_period_px < self.min_period_px {
            let remedy = "it must not be below min_period_px";
            let value = self.max_period_px;
            return Err(PatternError::Setting { family: "random", key: "max_period_px", value, remedy });
        }
        let mut random = SplitMix(self.seed);
        let (low, high) = (1.0 / self.max_period_px, 1.0 / self.min_period_px);
        // One frequency from each of N_WAVES equal parts of the band.
        let waves: Vec<[f64; 2]> = (0..N_WAVES)
            .map(|i| {
                let frequency = low + (high - low) * (i as f64 + random.uniform()) / N_WAVES as f64;
                [frequency, random.uniform()]
            })
            .collect();
        let n = self.axis.length(width, height);
        let sums: Vec<f64> =
            (0..n).map(|u| waves.iter().map(|[f, phase]| (TAU * (u as f64 * f + phase)).cos()).sum()).collect();
        let min = sums.iter().copied().fold(f64::INFINITY, f64::min);
        let max = sums.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let range = (max - min).max(1e-12);
        Ok(vec![along(self.axis, width, height, |u| (sums[u] - min) / range)])
    }
}
