//! Micro phase shifting: all periods short and nearly equal, so that neither indirect light nor defocus disturbs one
//! more than another (Gupta and Nayar, "Micro Phase Shifting", CVPR 2012).

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use super::error::{PatternError, check_period};
use super::noise::SplitMix;
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
    /// Returns the waves of the images for `n` columns, in order.
    ///
    /// # Errors
    ///
    /// A setting out of its range.
    pub fn waves(&self, n: usize) -> Result<Vec<Wave>, PatternError> {
        let periods = self.resolved(n)?.periods_px;
        let first = SHIFTS.map(|shift| Wave { period_px: periods[0], shift });
        Ok(first.into_iter().chain(periods[1..].iter().map(|&period_px| Wave { period_px, shift: 0.0 })).collect())
    }

    /// Returns the settings with the periods that they mean for `n` columns.
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

/// Chooses the periods of the band whose code keeps far columns furthest apart.
///
/// The paper searches its band for frequencies of small decoding error (its supplement); here: the score of a set is
/// the smallest code distance of two columns that the first phase cannot tell apart (they lie about a whole number of
/// its periods from each other). The best of random sets, then random steps from it, shrinking. The seed is fixed, so
/// that the same settings give the same periods everywhere.
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

/// Returns the smallest squared distance in (cos φ₂, …, cos φ_F) of columns whose first phases are nearly equal; as
/// soon as it is below `enough`, whatever it is then.
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
