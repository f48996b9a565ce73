//! Phase shifting with one or several periods, unwrapped in time.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, Matrix3};
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
const MAX_PERIODS: usize = 64;
const FINEST_PX: f64 = 20.0;
const LARGEST_FACTOR: f64 = 8.0;

impl PhaseShift {
    /// The waves of the images for `n` columns, in order.
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

    /// The same settings with the periods and steps that they mean for `n` columns.
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

/// The longest is longer than the image by one of the finest, so that noise does not take the first column for the last.
fn default_periods(n: usize) -> Vec<f64> {
    let ratio = n as f64 / FINEST_PX + 1.0;
    let levels = ratio.log(LARGEST_FACTOR).ceil() as i32;
    let factor = if levels > 0 { ratio.powf(1.0 / f64::from(levels)) } else { 1.0 };
    (0..=levels).map(|i| FINEST_PX * factor.powi(i)).collect()
}

/// What a decoder makes of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decoded {
    /// The column, with its fraction.
    pub column: f64,
    /// Amplitude of the waves in the pixel, the smallest where periods differ: ½ without blur and indirect light.
    pub amplitude: f64,
    /// Root mean square difference between the waves measured and those of the column, as intensity.
    pub residual: f64,
    /// The same of the best other column (at least half the shortest period away): near `residual`, the pixel is
    /// ambiguous. Infinite if there is no other.
    pub runner_up: f64,
}

/// Decodes phase-shifted waves of one or several periods.
///
/// Unwrapping is by maximum likelihood: of all columns at which the shortest period has the measured phase, the one whose
/// other phases agree best, weighed by their amplitudes; the fraction then is the weighted least-squares one of all
/// phases. The columns of the image are all there are, so noise cannot put a pixel outside. It does what heterodyne (beat) unwrapping and number-theoretic tables (Gushov and Solodkin 1991) do where
/// those are exact, takes any periods, and uses every phase at once, so no noise is amplified from level to level.
#[derive(Clone, Debug)]
pub struct PhaseDecoder {
    n: usize,
    groups: Vec<Group>,
    /// Of the shortest period.
    finest: usize,
    n_images: usize,
}

/// The images of one period.
#[derive(Clone, Debug)]
struct Group {
    period_px: f64,
    /// The images' places, and what each contributes to the cosine and sine parts of the wave.
    images: Vec<(usize, [f64; 2])>,
}

impl Group {
    /// Cosine and sine part of the wave in a pixel.
    fn measure(&self, values: &[f32]) -> [f64; 2] {
        let mut wave = [0.0; 2];
        for &(i, [c, s]) in &self.images {
            wave[0] += c * f64::from(values[i]);
            wave[1] += s * f64::from(values[i]);
        }
        wave
    }
}

/// Whether two periods are the same but for the accuracy of a fit.
pub(super) fn same_period(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-4 * a.min(b)
}

impl PhaseDecoder {
    /// A decoder for `n` columns and images that show `waves`, in any order; each period needs three shifts.
    ///
    /// # Errors
    ///
    /// No waves, a period out of range, or fewer than three different shifts of one.
    pub fn new(waves: &[Wave], n: usize) -> Result<Self, PatternError> {
        let no = |problem| PatternError::Code { family: "phase", problem };
        let mut groups: Vec<(f64, Vec<usize>)> = Vec::new();
        for (i, wave) in waves.iter().enumerate() {
            check_period("phase", "periods_px", wave.period_px)?;
            match groups.iter_mut().find(|g| same_period(g.0, wave.period_px)) {
                Some(group) => group.1.push(i),
                None => groups.push((wave.period_px, vec![i])),
            }
        }
        let groups: Option<Vec<Group>> = groups
            .into_iter()
            .map(|(period_px, images)| {
                // value = offset + C cos(2πu/p) + S sin(2πu/p), in which the shift is a rotation of (C, S).
                let rows = images.iter().flat_map(|&i| {
                    let (s, c) = (TAU * waves[i].shift).sin_cos();
                    [1.0, c, s]
                });
                let design = DMatrix::from_row_iterator(images.len(), 3, rows);
                let normal: Matrix3<f64> = (design.transpose() * &design).fixed_view::<3, 3>(0, 0).into();
                let invertible = normal.symmetric_eigenvalues().min() > 1e-3;
                let inverse = normal.try_inverse().filter(|_| invertible)?;
                let weights = inverse * design.transpose();
                let images = images.iter().enumerate().map(|(j, &i)| (i, [weights[(1, j)], weights[(2, j)]]));
                Some(Group { period_px, images: images.collect() })
            })
            .collect();
        let groups = groups.ok_or(no("each period needs three or more images of different shifts"))?;
        let finest = (0..groups.len()).min_by(|&a, &b| groups[a].period_px.total_cmp(&groups[b].period_px));
        let finest = finest.ok_or(no("there is no image"))?;
        if groups.len() > MAX_PERIODS {
            return Err(no("it has more than 64 periods"));
        }
        Ok(Self { n, groups, finest, n_images: waves.len() })
    }

    /// The column of a pixel from its normalized intensities, in the waves' order. `None` where a value is not finite or
    /// there is no wave at all.
    ///
    /// # Panics
    ///
    /// If there are more or fewer values than waves.
    pub fn decode(&self, values: &[f32]) -> Option<Decoded> {
        assert_eq!(values.len(), self.n_images, "one value per image");
        // (amplitude, phase in periods, period); decoders run over millions of pixels, so no allocation for usual sets.
        let mut measured = [(0.0, 0.0, 1.0); MAX_PERIODS];
        let measured = &mut measured[..self.groups.len()];
        for (m, group) in measured.iter_mut().zip(&self.groups) {
            let [c, s] = group.measure(values);
            *m = (c.hypot(s), (s.atan2(c) / TAU).rem_euclid(1.0), group.period_px);
        }
        let amplitude = measured.iter().map(|m| m.0).fold(f64::INFINITY, f64::min);
        let energy: f64 = measured.iter().map(|m| m.0 * m.0).sum();
        if !energy.is_finite() || energy < 1e-12 {
            return None;
        }
        let (_, phase, shortest) = measured[self.finest];
        let margin = 0.25 * shortest;
        let precision: f64 = measured.iter().map(|m| (m.0 / m.2).powi(2)).sum();
        let (mut best, mut second) = ((f64::INFINITY, 0.0), f64::INFINITY);
        let mut order = ((-0.5 - margin) / shortest - phase).ceil();
        loop {
            let start = (order + phase) * shortest;
            if start > self.n as f64 - 0.5 + margin {
                break;
            }
            order += 1.0;
            // Residual phases (periods) at the start, then the shift that makes the weighted sum of their squares least.
            let (mut moment, mut cost) = (0.0, 0.0);
            for &(a, phase, period) in measured.iter() {
                let r = phase - start / period;
                let r = r - r.round();
                moment += a * a * r / period;
                cost += a * a * r * r;
            }
            let column = (start + moment / precision).clamp(-0.5, self.n as f64 - 0.5);
            let shift = column - start;
            let cost = (cost - 2.0 * shift * moment + shift * shift * precision).max(0.0);
            if cost < best.0 {
                second = best.0;
                best = (cost, column);
            } else {
                second = second.min(cost);
            }
        }
        if best.0 == f64::INFINITY {
            return None;
        }
        // A phase error e (radians) of a wave of amplitude a is an intensity error of a·e/√2 (rms over the phase).
        let rms = |cost: f64| TAU * (0.5 * cost / measured.len() as f64).sqrt();
        Some(Decoded { column: best.1, amplitude, residual: rms(best.0), runner_up: rms(second) })
    }
}

#[cfg(test)]
mod tests {
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
            let got = decoder.decode(&values).unwrap();
            let error = got.column - u as f64;
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

    /// The variance of a phase from N steps is 2σ² / (N A²) rad² (e.g. Surrel 1996), which the finest period turns to px.
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
        let got = decoder.decode(&values).unwrap();
        assert!((got.column.rem_euclid(32.0) - 100.0_f64.rem_euclid(32.0)).abs() < 1e-3, "{got:?}");
        assert!(got.runner_up < 1e-3);
        assert_eq!(decoder.decode(&[f32::NAN; 4]), None);
        assert_eq!(decoder.decode(&[0.4; 4]), None);
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
