//! Images of one frequency.

use std::f64::consts::TAU;

use crate::pattern::error::{PatternError, check_period};
use crate::pattern::wave::Wave;

/// One image: `offset + amplitude · cos(2π f u − phase)` at column u, f being its group's frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveImage {
    /// Its place in the pattern set.
    pub image: usize,
    /// Its phase, radians.
    pub phase: f64,
}

/// The images of one frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct WaveGroup {
    /// Cycles per projector px.
    pub frequency: f64,
    /// The images.
    pub waves: Vec<WaveImage>,
}

impl WaveGroup {
    /// Returns the length of a period, px.
    pub fn period_px(&self) -> f64 {
        1.0 / self.frequency
    }

    /// Groups waves by their period, the shortest first; `family` is for messages.
    pub(super) fn all(waves: &[Wave], family: &'static str) -> Result<Vec<Self>, PatternError> {
        let mut groups: Vec<Self> = Vec::new();
        for (image, wave) in waves.iter().enumerate() {
            check_period(family, "periods_px", wave.period_px)?;
            let of_image = WaveImage { image, phase: TAU * wave.shift };
            match groups.iter_mut().find(|g| is_same_period(g.period_px(), wave.period_px)) {
                Some(group) => group.waves.push(of_image),
                None => groups.push(Self { frequency: 1.0 / wave.period_px, waves: vec![of_image] }),
            }
        }
        groups.sort_by(|a, b| b.frequency.total_cmp(&a.frequency));
        Ok(groups)
    }
}

/// Returns whether two periods differ by no more than the accuracy of a fit.
fn is_same_period(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-4 * a.min(b)
}
