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
