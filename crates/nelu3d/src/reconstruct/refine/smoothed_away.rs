//! What the prior takes from a surface, given back where it shows.
//!
//! A thin plate has no second differences at its edges, and little of what changes within what it averages over. Where a
//! body bends out of sight both are wrong, and the surface lies off by more than its noise. With S the smoother that
//! makes the solution x of what was measured, x lacks (1 − S) of the true surface, of which x itself tells: smoothed
//! again, it loses about as much again (Tukey, *Exploratory Data Analysis*, 1977: twicing). Here twice over, since what
//! a second smoothing takes is smaller than what the first took:
//!
//! ```text
//! y₁ = x + (x − S x),   y₂ = y₁ + (x − S y₁),   change = y₂ − x = (1 − S) (2 − S) x
//! ```
//!
//! Noise has a part in it, and other errors of what was measured; where there is nothing else they would only be added.
//! So the change is made by the part of its mean square that they do not explain.

use nelu3d_field::plate::{PlateStop, sweep};

use super::thin_plate::ThinPlatePrior;
use super::uncertainty::masked_mean;

/// Sweeps over the tiles of a system, each time that the surface is smoothed again: what a pixel changes by depends on
/// a few pixels around it. The second time what is smoothed has changed by little.
const SWEEPS: [usize; 2] = [2, 1];
/// Criterion of the solver in a tile.
const STOP: PlateStop = PlateStop { reduction: 3e-2, settled: 0.0, iterations: 120 };
/// Radius over which the change's mean square is compared with that of errors, px.
const RADIUS: usize = 3;
/// Mean square over that of errors below which there is nothing else. Neighbors are nearly the same, so that a mean over
/// the square of [`RADIUS`] is one of few.
const CHANCE: f32 = 4.0;

/// What is given back of what the prior took, per pixel of a window.
pub struct SmoothedAway {
    /// Change of the unknown; 0 where there is no surface.
    pub change: Vec<f32>,
    /// Variance of the unknown that is left: a change is hardly known better than by its own size.
    pub variance: Vec<f32>,
}

/// Returns what the prior takes from the solution `x` of data of information `h`, as far as it exceeds `noise`, the
/// variance of the change from noise and other errors of the data, per pixel.
pub fn smoothed_away(prior: &ThinPlatePrior, h: &[f32], x: &[f32], noise: &[f32]) -> SmoothedAway {
    let [n, width, height] = [x.len(), prior.width, prior.height];
    // S y, beside y: what the data would be solved to if they were y. The first change is small against the surface, so
    // that S y₁ is sought from S x.
    let (mut y, mut smooth) = (x.to_vec(), x.to_vec());
    for sweeps in SWEEPS {
        for turn in 0..sweeps {
            let g: Vec<f32> = (0..n).map(|i| h[i] * (smooth[i] - y[i])).collect();
            sweep(&prior.system(h, &g), &mut smooth, turn, f32::INFINITY, STOP);
        }
        (0..n).for_each(|i| y[i] += x[i] - smooth[i]);
    }
    let mut change: Vec<f32> = y.iter().zip(x).map(|(y, x)| y - x).collect();
    let mean = |map: &[f32]| masked_mean(map, &prior.active, width, height, RADIUS);
    let mut variance = mean(&change.iter().map(|c| c * c).collect::<Vec<_>>());
    let noise = mean(noise);
    for i in 0..n {
        let part =
            if prior.active[i] { (1.0 - CHANCE * noise[i] / variance[i].max(f32::MIN_POSITIVE)).max(0.0) } else { 0.0 };
        change[i] *= part;
        variance[i] *= part * part;
    }
    SmoothedAway { change, variance }
}
