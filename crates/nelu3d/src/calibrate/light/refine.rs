//! The light's center by robust Gauss-Newton on carried codewords.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::super::views::Level;
use super::center::{HOME, State};
use super::transport::{Row, Seed, Transport, partner};

/// What a refinement found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Refined {
    pub(super) state: State,
    /// Robust residual of the normalized intensity; infinite where too few samples could be carried.
    pub(super) scale: f64,
    /// Mean information of a measurement on the state: products of its two slopes, whose noise has no mean.
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
    /// Smallest residual that is not taken for noise. Most pixels of a binary code say nothing (0 stays 0), and without
    /// a bound the few at its edges, which tell everything, would be taken for outliers.
    pub(super) min_scale: f64,
    /// Strength of the pull towards the camera, as a fraction of the best determined direction's information.
    pub(super) pull: f64,
    /// Whether the center may be far away, so that slopes here and there have little to do with each other yet.
    pub(super) far: bool,
    /// Where the state is held along a direction that the codes leave open.
    pub(super) held: Option<Held>,
}

/// Part of the slopes' squares, noise included, that is added to their products, times the root of the number of
/// measurements: what products with noise may be off by.
const TRUST: f64 = 3.0;

/// Square of a step's length, in standard deviations that noise which is independent from pixel to pixel would leave, at
/// which the center has settled: the noise of codewords is not independent, and leaves more.
const SETTLED: f64 = 0.01;

/// A state that is held along one direction.
#[derive(Clone, Copy)]
pub(super) struct Held {
    pub(super) at: State,
    /// Unit direction.
    pub(super) along: Vector3<f64>,
    /// As a fraction of the best determined direction's information.
    pub(super) strength: f64,
}

/// Gauss-Newton with Cauchy weights on carried samples. A step is as much shorter as steps have turned back before: along
/// a direction that is hardly told, equal codewords are found here and there between the samples' noise, and the length
/// of a full step is noise as well (Kesten 1958, "Accelerated stochastic approximation", Ann. Math. Statist. 29:41).
pub(super) fn refine(t: &Transport<'_>, level: &Level, seeds: &[Seed], s: State, how: Steps) -> Refined {
    let mut out = Refined::at(s);
    let mut rows: Vec<Vec<Row>> = vec![Vec::new(); seeds.len().div_ceil(AT_A_TIME)];
    let (mut last, mut reversals) = (Vector3::zeros(), 0);
    for _ in 0..how.count {
        linearize(t, level, seeds, out.state, how.arm, &mut rows);
        let mut abs: Vec<f64> = rows.iter().flatten().map(|r| r.difference.abs()).collect();
        let n = abs.len();
        if n < 100 {
            return Refined { scale: f64::INFINITY, ..out };
        }
        let mid = n / 2;
        out.scale = (abs.select_nth_unstable_by(mid, f64::total_cmp).1.max(1e-6)) * 1.4826;
        let (mut noisy, mut a, mut b, mut weights) = (Matrix3::zeros(), Matrix3::zeros(), Vector3::zeros(), 0.0);
        for row in rows.iter().flatten() {
            let w = 1.0 / (1.0 + (row.difference / (2.0 * out.scale.max(how.min_scale))).powi(2));
            let j = row.here.map_or(row.there, |here| 0.5 * (row.there + here));
            noisy += j * j.transpose() * w;
            // The noise of one is not the noise of the other. Squares of slopes have their noise in them: of three
            // patterns without fine detail, under which the light's distance and direction are hardly told apart, it
            // was most of what seemed to be known, and steps were a small part of what they should have been.
            let product = row.here.map_or(row.there * row.there.transpose(), |here| row.there * here.transpose());
            a += (product + product.transpose()) * (0.5 * w);
            b += j * (row.difference * w);
            weights += w;
        }
        out.information = a / weights;
        a = if how.far { noisy } else { a + noisy * (TRUST / (n as f64).sqrt()) };
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
        // Along what the patterns hardly tell, slopes are mostly noise, and steps of full length jump to and fro.
        reversals += u32::from(step.dot(&(a * last)) < 0.0);
        last = step;
        let limit = (0.1 / step.amax().max(1e-12)).min(1.0) / f64::from(1 + reversals);
        for i in 0..3 {
            out.state[i] -= step[i] * limit;
        }
        if b.dot(&step).abs() < SETTLED * out.scale.powi(2) {
            break;
        }
    }
    out
}

/// Samples that are carried together.
const AT_A_TIME: usize = 512;

/// Writes slopes by the state and difference of every measurement that lands to `rows`, [`AT_A_TIME`] samples to one.
///
/// The slopes are those of the interpolated codewords where it lands, and central differences where it comes from.
/// One-sided differences would share their noise with the residual they are multiplied with, and that product has a
/// mean, which pushes the center away along everything that the patterns hardly tell; here its mean over all places
/// between the samples is zero.
fn linearize(t: &Transport<'_>, level: &Level, seeds: &[Seed], s: State, arm: usize, rows: &mut [Vec<Row>]) {
    let (light, slopes) = (t.chart.center(s), t.chart.slopes(s));
    seeds.par_chunks(AT_A_TIME).zip(rows).for_each(|(seeds, rows)| {
        rows.clear();
        let to = |seed: &Seed| partner(seed, arm, t.views.count());
        t.carry_with_slopes(level, seeds, (&light, &slopes), to, rows);
    });
}
