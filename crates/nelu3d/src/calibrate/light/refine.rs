//! The light's center by robust Gauss-Newton on carried codewords.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::super::views::Level;
use super::center::{HOME, State};
use super::transport::{Seed, Transport, partner};

/// What a refinement found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Refined {
    pub(super) state: State,
    /// Robust residual of the normalized intensity; infinite where too few samples could be carried.
    pub(super) scale: f64,
    /// Mean information of a measurement on the state, squared slopes.
    pub(super) information: Matrix3<f64>,
}

impl Refined {
    /// A state that nothing is known of.
    pub(super) fn at(state: State) -> Self {
        Self { state, scale: f64::INFINITY, information: Matrix3::zeros() }
    }
}

/// How a refinement is done.
#[derive(Clone, Copy)]
pub(super) struct Steps {
    /// Steps in depth between the views that are compared.
    pub(super) arm: usize,
    /// Largest number of steps.
    pub(super) count: usize,
    /// Step of every coordinate of the state that is not worth another.
    pub(super) enough: f64,
    /// Smallest residual that is not taken for noise. Most pixels of a binary code say nothing (0 stays 0), and without
    /// a bound the few at its edges, which tell everything, would be taken for outliers.
    pub(super) min_scale: f64,
    /// Strength of the pull towards the camera, as a fraction of the best determined direction's information.
    pub(super) pull: f64,
    /// Where the state is held along a direction that the codes leave open.
    pub(super) held: Option<Held>,
}

/// A state that is held along one direction.
#[derive(Clone, Copy)]
pub(super) struct Held {
    pub(super) at: State,
    /// Unit direction.
    pub(super) along: Vector3<f64>,
    /// As a fraction of the best determined direction's information.
    pub(super) strength: f64,
}

/// Fewest measurements that a step is taken from.
const MIN_MEASUREMENTS: usize = 100;
/// Residuals that their median is taken from, about.
const RESIDUALS: usize = 60_000;

/// Gauss-Newton with Cauchy weights on carried samples.
pub(super) fn refine(t: &Transport<'_>, level: &Level, seeds: &[Seed], s: State, how: Steps) -> Refined {
    let mut out = Refined::at(s);
    for _ in 0..how.count {
        let Some(scale) = scale(t, level, seeds, out.state, how.arm) else {
            return Refined { scale: f64::INFINITY, ..out };
        };
        out.scale = scale;
        let Equations { mut a, mut b, weights } =
            linearize(t, level, seeds, out.state, how.arm, 2.0 * scale.max(how.min_scale));
        out.information = a / weights;
        // Patterns that vary along one axis only leave the center free along the other: a faint pull to the camera
        // decides there, and is not felt elsewhere.
        let pull = a.diagonal().max() * how.pull;
        for i in 0..3 {
            a[(i, i)] += pull;
            b[i] += pull * (out.state[i] - HOME[i]);
        }
        if let Some(held) = how.held {
            let strength = a.diagonal().max() * held.strength;
            let off = Vector3::from(out.state) - Vector3::from(held.at);
            a += strength * held.along * held.along.transpose();
            b += strength * held.along * held.along.dot(&off);
        }
        let Some(step) = a.try_inverse().map(|i| i * b) else { break };
        let limit = (0.1 / step.amax().max(1e-12)).min(1.0);
        for i in 0..3 {
            out.state[i] -= step[i] * limit;
        }
        if step.amax() < how.enough {
            break;
        }
    }
    out
}

/// Robust scale of the residuals, from an even selection of them; `None` where too few samples land.
fn scale(t: &Transport<'_>, level: &Level, seeds: &[Seed], s: State, arm: usize) -> Option<f64> {
    let light = t.chart.center(s);
    let (k, stride) = (t.views.k, (seeds.len() * t.views.k / RESIDUALS).max(1));
    let of = |chunk: &[Seed]| {
        let (mut abs, mut r) = (Vec::with_capacity(chunk.len().div_ceil(stride) * k), vec![0.0; k]);
        for seed in chunk.iter().step_by(stride) {
            if t.carry(level, seed, &light, partner(seed, arm, t.views.len()), &mut r) {
                abs.extend(r.iter().map(|r| r.abs()));
            }
        }
        abs
    };
    // A multiple of the stride, so that chunks do not show in the selection.
    let mut abs = seeds.par_chunks(stride * 512).map(of).collect::<Vec<_>>().concat();
    if abs.len() < MIN_MEASUREMENTS {
        return None;
    }
    let mid = abs.len() / 2;
    Some(abs.select_nth_unstable_by(mid, f64::total_cmp).1.max(1e-6) * 1.4826)
}

/// Normal equations of a step, and the sum of the weights of what they were made from.
struct Equations {
    a: Matrix3<f64>,
    b: Vector3<f64>,
    weights: f64,
}

/// Sums the normal equations of every measurement that lands, with Cauchy weights of a width. Deterministic for any
/// number of threads.
///
/// The slopes are those of the interpolated codewords. One-sided differences would share their noise with the residual
/// they are multiplied with, and that product has a mean, which pushes the center away along everything that the
/// patterns hardly tell; here its mean over all places between the samples is zero.
fn linearize(t: &Transport<'_>, level: &Level, seeds: &[Seed], s: State, arm: usize, width: f64) -> Equations {
    let (light, slopes) = (t.chart.center(s), t.chart.slopes(s));
    let none = || Equations { a: Matrix3::zeros(), b: Vector3::zeros(), weights: 0.0 };
    let of = |chunk: &[Seed]| {
        let (mut sum, mut rows) = (none(), Vec::with_capacity(t.views.k));
        for seed in chunk {
            rows.clear();
            t.carry_with_slopes(level, seed, (&light, &slopes), partner(seed, arm, t.views.len()), &mut rows);
            for row in &rows {
                let j = Vector3::new(row[0], row[1], row[2]);
                let w = 1.0 / (1.0 + (row[3] / width).powi(2));
                sum.a += j * j.transpose() * w;
                sum.b += j * (row[3] * w);
                sum.weights += w;
            }
        }
        sum
    };
    let join = |sum: Equations, of: Equations| Equations {
        a: sum.a + of.a,
        b: sum.b + of.b,
        weights: sum.weights + of.weights,
    };
    seeds.par_chunks(1024).map(of).collect::<Vec<_>>().into_iter().fold(none(), join)
}
