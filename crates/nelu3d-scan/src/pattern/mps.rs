//! Micro phase shifting: all periods short and nearly equal, so that neither indirect light nor defocus disturbs one more
//! than another (Gupta and Nayar, "Micro Phase Shifting", CVPR 2012).

use std::f64::consts::TAU;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use super::error::{PatternError, check_period};
use super::noise::SplitMix;
use super::phase::{Decoded, same_period};
use super::wave::Wave;
use crate::image::Image;

/// F frequencies in F + 2 images: the first in three shifts, every other in one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Mps {
    /// Direction of change.
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Number of frequencies; there are two images more.
    #[cfg_attr(feature = "clap", arg(long, value_name = "F", default_value_t = 5))]
    pub frequencies: usize,
    /// Middle of the band that periods are chosen from, px: about 16 against interreflection, 64 against defocus.
    #[cfg_attr(feature = "clap", arg(long = "mean-period", value_name = "PX", default_value_t = 16.0))]
    pub mean_period_px: f64,
    /// Half the width of the band, as a part of its middle.
    #[cfg_attr(feature = "clap", arg(long, value_name = "PART", default_value_t = 0.1))]
    pub band: f64,
    /// The periods themselves, the first in three shifts (default: chosen from the band).
    #[cfg_attr(feature = "clap", arg(long = "period", value_name = "PX", value_delimiter = ','))]
    pub periods_px: Vec<f64>,
}

impl Default for Mps {
    fn default() -> Self {
        Self { axis: Axis::X, frequencies: 5, mean_period_px: 16.0, band: 0.1, periods_px: Vec::new() }
    }
}

/// Shifts of the first frequency.
const SHIFTS: [f64; 3] = [0.0, 1.0 / 3.0, 2.0 / 3.0];

impl Mps {
    /// The waves of the images for `n` columns, in order.
    ///
    /// # Errors
    ///
    /// A setting out of its range.
    pub fn waves(&self, n: usize) -> Result<Vec<Wave>, PatternError> {
        let periods = self.resolved(n)?.periods_px;
        let first = SHIFTS.map(|shift| Wave { period_px: periods[0], shift });
        Ok(first.into_iter().chain(periods[1..].iter().map(|&period_px| Wave { period_px, shift: 0.0 })).collect())
    }

    /// The same settings with the periods that they mean for `n` columns.
    ///
    /// # Errors
    ///
    /// A setting out of its range.
    pub fn resolved(&self, n: usize) -> Result<Self, PatternError> {
        let wrong = |key, value, remedy| PatternError::Setting { family: "mps", key, value, remedy };
        let periods_px = if self.periods_px.is_empty() {
            check_period("mps", "mean_period_px", self.mean_period_px)?;
            if !(2..=32).contains(&self.frequencies) {
                return Err(wrong("frequencies", self.frequencies as f64, "give 2 to 32"));
            }
            if !(0.001..=0.5).contains(&self.band) {
                return Err(wrong("band", self.band, "give 0.001 to 0.5"));
            }
            check_period("mps", "mean_period_px", self.mean_period_px * (1.0 - self.band))?;
            choose_periods(self.frequencies, self.mean_period_px, self.band, n)
        } else {
            if !(2..=32).contains(&self.periods_px.len()) {
                return Err(wrong("periods_px", self.periods_px.len() as f64, "give 2 to 32 periods"));
            }
            self.periods_px.clone()
        };
        for &period_px in &periods_px {
            check_period("mps", "periods_px", period_px)?;
        }
        Ok(Self { frequencies: periods_px.len(), periods_px, ..self.clone() })
    }

    pub(super) fn generate(&self, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
        let waves = self.waves(self.axis.length(width, height))?;
        Ok(waves.iter().map(|w| along(self.axis, width, height, |u| w.value(u as f64))).collect())
    }
}

/// Periods of the band whose code keeps far columns furthest apart.
///
/// The paper searches its band for frequencies of small decoding error (its supplement); here: the score of a set is the
/// smallest code distance of two columns that the first phase cannot tell apart (they lie about a whole number of its
/// periods from each other). The best of random sets, then random steps from it, shrinking. The seed is fixed, so that
/// the same settings give the same periods everywhere.
fn choose_periods(frequencies: usize, mean_px: f64, band: f64, n: usize) -> Vec<f64> {
    const SETS: usize = 1000;
    const STEPS: usize = 2000;
    let mut random = SplitMix(2012);
    let (low, high) = (mean_px * (1.0 - band), mean_px * (1.0 + band));
    let mut best: (f32, Vec<f64>) = (-1.0, Vec::new());
    for i in 0..SETS + STEPS {
        let reach = 0.5 * (high - low) * 0.5 * (1.0 - i.saturating_sub(SETS) as f64 / STEPS as f64);
        let set: Vec<f64> = (0..frequencies)
            .map(|f| {
                let r = random.uniform();
                if i < SETS { low + (high - low) * r } else { (best.1[f] + reach * (2.0 * r - 1.0)).clamp(low, high) }
            })
            .collect();
        let score = smallest_distance(&set, n, best.0);
        if score > best.0 || best.1.is_empty() {
            best = (score, set);
        }
    }
    best.1
}

/// The smallest squared distance in (cos φ₂, …, cos φ_F) of columns whose first phases are nearly equal; as soon as it is
/// below `enough`, whatever it is then.
fn smallest_distance(periods: &[f64], n: usize, enough: f32) -> f32 {
    let rows: Vec<Vec<f32>> =
        periods[1..].iter().map(|p| (0..n).map(|u| (TAU * u as f64 / p).cos() as f32).collect()).collect();
    let mut smallest = f32::MAX;
    let mut sums = vec![0.0_f32; n];
    for order in 1.. {
        let shift = order as f64 * periods[0];
        if shift.ceil() as usize >= n {
            break;
        }
        for shift in [shift.floor() as usize, shift.ceil() as usize] {
            let sums = &mut sums[..n - shift];
            sums.fill(0.0);
            for row in &rows {
                for ((sum, a), b) in sums.iter_mut().zip(row).zip(&row[shift..]) {
                    *sum += (a - b) * (a - b);
                }
            }
            smallest = sums.iter().copied().fold(smallest, f32::min);
            if smallest <= enough {
                return smallest;
            }
        }
    }
    smallest
}

/// Decodes micro phase shifting: one linear solve, the nearest column, its fraction from the first phase.
#[derive(Clone, Debug)]
pub struct MpsDecoder {
    n: usize,
    first_period: f64,
    /// `(F + 2) × images`, row by row: offset, A cos φ₁, A sin φ₁, A cos(φ_f − its shift) from the intensities.
    solve: Vec<f64>,
    n_images: usize,
    /// `(F + 1) × n`: the same of every column without offset and with A = 1.
    table: Vec<f32>,
    rows: usize,
}

impl MpsDecoder {
    /// A decoder for `n` columns and images that show `waves`, in any order: one period in at least three shifts, every
    /// other in one.
    ///
    /// # Errors
    ///
    /// The waves are not such a set.
    pub fn new(waves: &[Wave], n: usize) -> Result<Self, PatternError> {
        let no = |problem| PatternError::Code { family: "mps", problem };
        let mut periods: Vec<(f64, Vec<usize>)> = Vec::new();
        for (i, wave) in waves.iter().enumerate() {
            check_period("mps", "periods_px", wave.period_px)?;
            match periods.iter_mut().find(|p| same_period(p.0, wave.period_px)) {
                Some(period) => period.1.push(i),
                None => periods.push((wave.period_px, vec![i])),
            }
        }
        let shifted = periods.iter().position(|p| p.1.len() > 2);
        let first =
            periods.swap_remove(shifted.ok_or(no("one period needs three or more images of different shifts"))?);
        if periods.is_empty() || periods.iter().any(|p| p.1.len() > 1) {
            return Err(no("all periods but one have one image each, and there is one such at least"));
        }
        let others: Vec<usize> = periods.iter().map(|p| p.1[0]).collect();
        let unknowns = 3 + others.len();
        let mut design = DMatrix::zeros(waves.len(), unknowns);
        design.column_mut(0).fill(1.0);
        for &i in &first.1 {
            let (s, c) = (TAU * waves[i].shift).sin_cos();
            (design[(i, 1)], design[(i, 2)]) = (c, s);
        }
        for (f, &i) in others.iter().enumerate() {
            design[(i, 3 + f)] = 1.0;
        }
        let svd = design.svd(true, true);
        if svd.singular_values.min() < 1e-2 {
            return Err(no("the shifts of its first period are not different"));
        }
        let inverse = svd.pseudo_inverse(1e-9).expect("both factors were asked for");
        let solve = inverse.row_iter().flat_map(|r| r.iter().copied().collect::<Vec<_>>()).collect();
        let quarter = Wave { period_px: first.0, shift: 0.25 };
        let shown = [Wave { shift: 0.0, ..quarter }, quarter].into_iter().chain(others.iter().map(|&i| waves[i]));
        let table = shown.flat_map(|w| (0..n).map(move |u| (2.0 * w.value(u as f64) - 1.0) as f32)).collect();
        Ok(Self { n, first_period: first.0, solve, n_images: waves.len(), table, rows: unknowns - 1 })
    }

    /// The column of a pixel from its normalized intensities, in the waves' order. `None` where a value is not finite or
    /// there is no wave at all.
    ///
    /// # Panics
    ///
    /// If there are more or fewer values than waves.
    pub fn decode(&self, values: &[f32]) -> Option<Decoded> {
        assert_eq!(values.len(), self.n_images, "one value per image");
        let unknown = |row: usize| -> f64 {
            let weights = &self.solve[row * self.n_images..(row + 1) * self.n_images];
            weights.iter().zip(values).map(|(w, &v)| w * f64::from(v)).sum()
        };
        let (c, s) = (unknown(1), unknown(2));
        let amplitude = c.hypot(s);
        if !values.iter().all(|v| v.is_finite()) || amplitude < 1e-6 {
            return None;
        }
        let mut distances = vec![0.0_f32; self.n];
        for row in 0..self.rows {
            let target = (unknown(row + 1) / amplitude) as f32;
            let column = &self.table[row * self.n..(row + 1) * self.n];
            distances.iter_mut().zip(column).for_each(|(d, t)| *d += (t - target) * (t - target));
        }
        let least = distances.iter().copied().fold(f32::INFINITY, f32::min);
        let nearest = distances.iter().position(|&d| d == least)?;
        let far = (0.5 * self.first_period).ceil() as usize;
        let others = distances[..nearest.saturating_sub(far - 1)].iter().chain(distances.iter().skip(nearest + far));
        let second = others.copied().fold(f32::INFINITY, f32::min);

        let periods = s.atan2(c) / TAU;
        let order = (nearest as f64 / self.first_period - periods).round();
        // (F + 1) numbers of the size of cosines, of which two share one image's worth of noise.
        let rms = |d: f32| amplitude * (f64::from(d) / self.rows as f64).sqrt();
        let column = (order + periods) * self.first_period;
        Some(Decoded { column, amplitude, residual: rms(least), runner_up: rms(second) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Decoded columns minus true ones, of a camera with gain, offset and noise that sees 8-bit images.
    fn errors(pattern: &Mps, n: usize, sigma: f64) -> Vec<f64> {
        let decoder = MpsDecoder::new(&pattern.waves(n).unwrap(), n).unwrap();
        let images = pattern.generate(n, 1).unwrap();
        assert_eq!(images.len(), pattern.waves(n).unwrap().len());
        let mut random = SplitMix(5);
        (0..n)
            .map(|u| {
                let values: Vec<f32> = images
                    .iter()
                    .map(|i| {
                        let shown = (f64::from(i.data[u]) * 255.0).round() / 255.0;
                        (0.7 * shown + 0.1 + sigma * random.normal()) as f32
                    })
                    .collect();
                decoder.decode(&values).unwrap().column - u as f64
            })
            .collect()
    }

    #[test]
    fn columns_come_back_with_their_fractions() {
        for (mean_period_px, frequencies, n) in [(16.0, 5, 640), (64.0, 5, 1280), (32.0, 6, 800)] {
            let pattern = Mps { mean_period_px, frequencies, ..Mps::default() };
            let worst = errors(&pattern, n, 0.0).iter().fold(0.0_f64, |a, e| a.max(e.abs()));
            assert!(worst < 0.3 * mean_period_px / 16.0, "{frequencies} about {mean_period_px} px: {worst}");
        }
    }

    #[test]
    fn noise_moves_columns_a_little() {
        let e = errors(&Mps::default(), 1280, 0.01);
        let rms = (e.iter().map(|e| e * e).sum::<f64>() / 1280.0).sqrt();
        // The first phase's own, from three steps.
        let expected = 16.0 / TAU * (2.0_f64 / 3.0).sqrt() * 0.01 / 0.35;
        assert!((0.8..1.2).contains(&(rms / expected)), "{rms} px, not {expected}");
    }

    #[test]
    fn images_are_two_more_than_frequencies_and_lie_in_the_band() {
        let pattern = Mps { frequencies: 4, mean_period_px: 64.0, band: 0.05, ..Mps::default() };
        let waves = pattern.waves(1024).unwrap();
        assert_eq!(waves.len(), 6);
        assert!(waves.iter().all(|w| (60.8..=67.2).contains(&w.period_px)), "{waves:?}");
        assert_eq!(waves, pattern.resolved(1024).unwrap().waves(1024).unwrap());
    }

    #[test]
    fn chosen_periods_beat_an_even_spread() {
        let chosen: Vec<f64> = Mps::default().waves(1280).unwrap()[2..].iter().map(|w| w.period_px).collect();
        let even: Vec<f64> = (0..5).map(|i| 14.4 + 0.8 * f64::from(i)).collect();
        let score = |p: &[f64]| smallest_distance(p, 1280, -1.0);
        assert!(score(&chosen) > 2.0 * score(&even), "{} and {}", score(&chosen), score(&even));
    }

    #[test]
    fn other_sets_are_refused() {
        let wave = |period_px, shift| Wave { period_px, shift };
        for waves in [
            vec![],
            vec![wave(16.0, 0.0), wave(16.0, 0.3), wave(16.0, 0.6)],
            vec![wave(16.0, 0.0), wave(16.0, 0.3), wave(15.0, 0.0)],
            vec![wave(16.0, 0.0), wave(16.0, 0.0), wave(16.0, 1.0), wave(15.0, 0.0)],
        ] {
            assert!(MpsDecoder::new(&waves, 640).is_err(), "{waves:?}");
        }
        for pattern in [
            Mps { frequencies: 1, ..Mps::default() },
            Mps { mean_period_px: f64::NAN, ..Mps::default() },
            Mps { band: 0.9, ..Mps::default() },
            Mps { periods_px: vec![16.0], ..Mps::default() },
            Mps { periods_px: vec![16.0, 1.0], ..Mps::default() },
        ] {
            assert!(pattern.generate(64, 2).is_err(), "{pattern:?}");
        }
    }
}
