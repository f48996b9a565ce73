//! Phase shifting with one or several periods, unwrapped in time.

use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use super::error::{PatternError, check_period};
use super::wave::Wave;
use crate::image::Image;

/// `½ + ½ cos 2π(u / period − i / steps)` for image i of every period, one period after the other.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct PhaseShift {
    /// Direction of change.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Lengths of the periods, px (default: from 20 px up by a factor of at most 8 to one that spans the image).
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(long = "period", value_name = "PX", value_delimiter = ','))]
    pub periods_px: Vec<f64>,
    /// Images of each period: one number for all, or one for each (default: 4).
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", value_delimiter = ','))]
    pub steps: Vec<usize>,
}

const DEFAULT_STEPS: usize = 4;
/// Most periods of a set.
pub(super) const MAX_PERIODS: usize = 64;
const FINEST_PX: f64 = 20.0;
const LARGEST_FACTOR: f64 = 8.0;

impl PhaseShift {
    /// Returns the waves of the images for `n` columns, in order.
    ///
    /// # Errors
    ///
    /// A period below 2 px, fewer than 3 steps or more than 64, or another number of steps than of periods.
    pub fn waves(&self, n: usize) -> Result<Vec<Wave>, PatternError> {
        let all = self.resolved(n)?;
        let periods = all.periods_px.iter().zip(all.steps);
        Ok(periods
            .flat_map(|(&period_px, steps)| (0..steps).map(move |i| Wave { period_px, shift: i as f64 / steps as f64 }))
            .collect())
    }

    /// Returns the settings with the periods and steps that they mean for `n` columns.
    ///
    /// # Errors
    ///
    /// As [`PhaseShift::waves`].
    pub fn resolved(&self, n: usize) -> Result<Self, PatternError> {
        let wrong = |key, value, remedy| PatternError::Setting { family: "phase", key, value, remedy };
        let periods_px = if self.periods_px.is_empty() { default_periods(n) } else { self.periods_px.clone() };
        if periods_px.len() > MAX_PERIODS {
            return Err(wrong("periods_px", periods_px.len() as f64, "give at most 64 periods"));
        }
        let steps = match self.steps.as_slice() {
            [] => vec![DEFAULT_STEPS; periods_px.len()],
            [all] => vec![*all; periods_px.len()],
            each if each.len() == periods_px.len() => each.to_vec(),
            each => return Err(wrong("steps", each.len() as f64, "give one number, or one for each period")),
        };
        for (&period_px, &steps) in periods_px.iter().zip(&steps) {
            check_period("phase", "periods_px", period_px)?;
            if !(3..=64).contains(&steps) {
                return Err(wrong("steps", steps as f64, "give 3 to 64: a phase has three unknowns"));
            }
        }
        Ok(Self { axis: self.axis, periods_px, steps })
    }

    pub(super) fn generate(&self, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
        let waves = self.waves(self.axis.length(width, height))?;
        Ok(waves.iter().map(|w| along(self.axis, width, height, |u| w.value(u as f64))).collect())
    }
}

/// Returns periods of which the longest is longer than the image by one of the finest, so that noise does not take the
/// first column for the last.
fn default_periods(n: usize) -> Vec<f64> {
    let ratio = n as f64 / FINEST_PX + 1.0;
    let levels = ratio.log(LARGEST_FACTOR).ceil() as i32;
    let factor = if levels > 0 { ratio.powf(1.0 / f64::from(levels)) } else { 1.0 };
    (0..=levels).map(|i| FINEST_PX * factor.powi(i)).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::decoder::PhaseDecoder;
    use super::super::noise::SplitMix;
    use super::*;

    /// Worst and root mean square error over all columns of what a camera with this noise makes of the images.
    fn errors(pattern: &PhaseShift, n: usize, sigma: f64) -> (f64, f64) {
        let decoder = PhaseDecoder::new(&pattern.waves(n).unwrap(), n).unwrap();
        let (w, h) = if pattern.axis == Axis::X { (n, 1) } else { (1, n) };
        let images = pattern.generate(w, h).unwrap();
        let mut random = SplitMix(3);
        let (mut worst, mut squares): (f64, f64) = (0.0, 0.0);
        for u in 0..n {
            let values: Vec<f32> = images
                .iter()
                .map(|i| {
                    let shown = (f64::from(i.data[u]) * 255.0).round() / 255.0;
                    (0.6 * shown + 0.2 + sigma * random.normal()) as f32
                })
                .collect();
            let got = decoder.decode(&values, sigma as f32).unwrap();
            let error = f64::from(got.column) - u as f64;
            worst = worst.max(error.abs());
            squares += error * error;
        }
        (worst, (squares / n as f64).sqrt())
    }

    fn pattern(axis: Axis, periods_px: &[f64], steps: &[usize]) -> PhaseShift {
        PhaseShift { axis, periods_px: periods_px.into(), steps: steps.into() }
    }

    #[test]
    fn columns_come_back_with_their_fractions() {
        for n in [8, 20, 21, 800, 1280, 1920] {
            let (worst, _) = errors(&pattern(Axis::X, &[], &[]), n, 0.0);
            assert!(worst < 0.05, "{n} columns: {worst} px, by 8-bit codes alone");
        }
        for (periods, steps) in [
            (vec![1500.0], vec![3]),
            // Beats: 59 · 60 and 1 / (1/59 − 2/60 + 1/61) periods are longer than the image.
            (vec![59.0, 60.0, 61.0], vec![4]),
            // Unambiguous over the least common multiple, 10,800 px.
            (vec![16.0, 27.0, 25.0], vec![3, 4, 5]),
            (vec![160.0, 20.0, 1290.0], vec![8]),
        ] {
            let (worst, _) = errors(&pattern(Axis::Y, &periods, &steps), 1280, 0.0);
            let finest = periods.iter().copied().fold(f64::MAX, f64::min);
            assert!(worst < 1e-3 * finest, "{periods:?}: {worst} px");
        }
    }

    /// The variance of a phase from N steps is 2σ² / (N A²) rad² (e.g. Surrel 1996), which the finest period turns to
    /// px.
    #[test]
    fn noise_costs_what_theory_says() {
        let sigma = 0.01;
        for steps in [3, 4, 8] {
            let (worst, rms) = errors(&pattern(Axis::X, &[20.0, 160.0, 1280.0], &[steps]), 1280, sigma);
            let expected = 20.0 / TAU * (2.0 / steps as f64).sqrt() * sigma / 0.3;
            assert!((0.9..1.15).contains(&(rms / expected)) && worst < 5.0 * expected, "{steps}: {rms}, {worst}");
        }
    }

    #[test]
    fn an_ambiguous_pixel_says_so() {
        let one = pattern(Axis::X, &[32.0], &[4]);
        let decoder = PhaseDecoder::new(&one.waves(640).unwrap(), 640).unwrap();
        let values: Vec<f32> = one.generate(640, 1).unwrap().iter().map(|i| i.data[100]).collect();
        let got = decoder.decode(&values, 0.0).unwrap();
        assert!((got.column.rem_euclid(32.0) - 100.0_f32.rem_euclid(32.0)).abs() < 1e-3, "{got:?}");
        assert!(got.runner_up < 1e-3 && !got.is_reliable(), "{got:?}");
        assert_eq!(decoder.decode(&[f32::NAN; 4], 0.0), None);
        assert_eq!(decoder.decode(&[0.4; 4], 0.0), None);
    }

    #[test]
    fn impossible_settings_are_refused() {
        for (periods, steps) in
            [(vec![1.0], vec![4]), (vec![20.0], vec![2]), (vec![20.0, 30.0], vec![3, 3, 3]), (vec![f64::NAN], vec![4])]
        {
            assert!(pattern(Axis::X, &periods, &steps).generate(64, 4).is_err());
        }
        let wave = |shift| Wave { period_px: 20.0, shift };
        assert!(PhaseDecoder::new(&[], 64).is_err());
        assert!(PhaseDecoder::new(&[wave(0.0), wave(0.5)], 64).is_err());
        assert!(PhaseDecoder::new(&[wave(0.0), wave(0.5), wave(1.0)], 64).is_err());
    }
}
