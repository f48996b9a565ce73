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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn its_power_lies_in_its_band() {
        let n = 1600;
        let pattern = Random { axis: Axis::X, min_period_px: 20.0, max_period_px: 80.0, seed: 5 };
        let line = pattern.generate(n, 1).unwrap().remove(0).data;
        let mean = line.iter().sum::<f32>() as f64 / n as f64;
        // The power at k cycles per image, under a window that keeps a wave between two bins from leaking far.
        let power = |k: usize| {
            let (mut c, mut s) = (0.0, 0.0);
            for (u, &v) in line.iter().enumerate() {
                let window = 0.5 - 0.5 * (TAU * u as f64 / n as f64).cos();
                let a = TAU * (k * u) as f64 / n as f64;
                c += (f64::from(v) - mean) * window * a.cos();
                s += (f64::from(v) - mean) * window * a.sin();
            }
            c * c + s * s
        };
        let all: f64 = (1..n / 2).map(power).sum();
        let inside: f64 = (n / 80 - 3..=n / 20 + 3).map(power).sum();
        assert!(inside > 0.999 * all, "{inside} of {all}");
        let other = Random { seed: 6, ..pattern }.generate(n, 1).unwrap().remove(0).data;
        assert_ne!(line, other);
    }

    #[test]
    fn impossible_bands_are_refused() {
        for (min_period_px, max_period_px) in [(1.0, 8.0), (9.0, 8.0), (8.0, f64::NAN)] {
            assert!(Random { axis: Axis::X, min_period_px, max_period_px, seed: 0 }.generate(8, 8).is_err());
        }
    }
}
