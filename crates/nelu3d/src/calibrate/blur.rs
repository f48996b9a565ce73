//! Blur of the camera, as edges of ink show it in the codewords.
//!
//! Beside an edge of ink most of a pixel's light comes from the paper, and its codeword is that of a place on it (see
//! [`Blur`]). How far away that is need not be known beforehand: paper tells its codewords and their slopes away from
//! edges; continued to pixels beside an edge, they leave a residual there of slope times shift.

use nalgebra::{SMatrix, SVector};
use nelu3d_scan::statistics::median;

use super::position::Position;
use crate::sensor::Blur;

/// Radius of the paper from which codewords are continued to an edge, samples.
const RADIUS: usize = 4;
/// Gradients of the logarithm of white − black per sample: below the first there is no edge, and beyond the last the
/// difference of two samples is no gradient.
const EVEN: f32 = 0.08;
const EDGE: [f32; 2] = [0.12, 0.8];
/// White − black of paper beside an edge, and of a sample at one, over the largest around it.
const PAPER: f32 = 0.75;
const LEAST: f32 = 0.3;
/// Fewest samples of paper, and the largest variance of what is continued from them over that of a sample.
const MIN_PAPER: usize = 24;
const MAX_LEVERAGE: f64 = 3.0;
/// Most samples of a position that are looked at, and the squares that its image is divided into.
const SAMPLES: usize = 1_000;
const SQUARES: usize = 6;
/// Groups of squares that each tell s², and the largest standard error of it, square samples.
const GROUPS: usize = 12;
const MAX_ERROR: f64 = 0.15;
/// Standard deviations beyond what an s² of 1 explains from which a codeword is not the paper's, continued.
const FAR: f64 = 3.0;
/// s² where edges of ink do not tell it: a pixel's own area, and optics of 0.4 pixels.
const TYPICAL: f32 = 0.25;
/// Largest s² that is believed.
const MOST: f64 = 2.0;

/// Gathers what positions tell of the blur.
#[derive(Clone, Debug, Default)]
pub struct BlurEstimator {
    /// Information about s² from squares of images, and that times s².
    squares: Vec<[f64; 2]>,
}

impl BlurEstimator {
    /// Adds a position; only samples for which `on_board` holds are looked at.
    pub fn add(&mut self, position: &Position, on_board: impl Fn(usize) -> bool) {
        let (w, h) = (position.width, position.height);
        if w.min(h) <= 2 * RADIUS {
            return;
        }
        let inner = (RADIUS..h - RADIUS).flat_map(|y| (RADIUS..w - RADIUS).map(move |x| y * w + x));
        let edge = EDGE.map(|gradient| gradient * gradient);
        let is_edge = |i: &usize| {
            let [x, y] = position.log_gradient(*i);
            (edge[0]..edge[1]).contains(&(x * x + y * y))
        };
        let edges: Vec<usize> = inner.filter(is_edge).filter(|i| on_board(*i)).collect();
        let mut squares = [[0.0; 2]; SQUARES * SQUARES];
        for i in edges.iter().copied().step_by(edges.len().div_ceil(SAMPLES).max(1)) {
            let square = &mut squares[i / w * SQUARES / h * SQUARES + i % w * SQUARES / w];
            let told = at_edge(position, i).unwrap_or_default();
            square.iter_mut().zip(told).for_each(|(sum, v)| *sum += v);
        }
        self.squares.extend(squares.into_iter().filter(|square| *square != [0.0; 2]));
    }

    /// Joins what other positions tell.
    pub fn merge(&mut self, other: &Self) {
        self.squares.extend_from_slice(&other.squares);
    }

    /// Returns the blur: the median of what groups of squares tell, or a typical one where too little is known.
    pub fn finish(&self) -> Blur {
        let mut groups = [[0.0; 2]; GROUPS];
        for (i, square) in self.squares.iter().enumerate() {
            groups[i % GROUPS].iter_mut().zip(square).for_each(|(sum, v)| *sum += v);
        }
        let mut of_groups: Vec<f64> =
            groups.iter().filter(|[known, _]| *known > 0.0).map(|[known, s]| s / known).collect();
        if of_groups.len() < GROUPS {
            return Blur::new(TYPICAL);
        }
        let s2 = median(&mut of_groups).unwrap_or_default();
        let spread = median(&mut of_groups.iter().map(|s| (s - s2).abs()).collect::<Vec<f64>>()).unwrap_or_default();
        // A median is off by 1.25 and its spread is 0.67 standard deviations.
        let error = 1.25 * 1.48 * spread / (GROUPS as f64).sqrt();
        tracing::debug!(s2, error, squares = self.squares.len(), "blur of the camera, square samples");
        if error < MAX_ERROR { Blur::new(s2.clamp(0.0, MOST) as f32) } else { Blur::new(TYPICAL) }
    }
}

/// Returns the information that a sample at an edge has about s², and that times s².
fn at_edge(position: &Position, i: usize) -> Option<[f64; 2]> {
    const TERMS: usize = 6;
    let (w, k) = (position.width, position.k);
    let rows = || (0..=2 * RADIUS).map(|y| i - RADIUS * (w + 1) + y * w);
    let around = || rows().flat_map(|row| row..=row + 2 * RADIUS);
    let brightest = around().map(|j| position.mean_contrast_at(j)).fold(0.0, f32::max);
    let own = position.mean_contrast_at(i);
    if own < LEAST * brightest {
        return None;
    }
    let is_even = |j: usize| {
        let [x, y] = position.log_gradient(j);
        x * x + y * y < EVEN * EVEN
    };
    let is_paper =
        |j: &usize| position.mean_contrast_at(*j) >= PAPER * brightest && position.is_wholly_usable(*j) && is_even(*j);
    let terms = |j: usize| {
        let x = ((j % w) as f64 - (i % w) as f64) / RADIUS as f64;
        let y = ((j / w) as f64 - (i / w) as f64) / RADIUS as f64;
        SVector::<f64, TERMS>::from([1.0, x, y, x * x, x * y, y * y])
    };
    let paper: Vec<(usize, SVector<f64, TERMS>)> = around().filter(is_paper).map(|j| (j, terms(j))).collect();
    if paper.len() < MIN_PAPER || !position.is_wholly_usable(i) {
        return None;
    }
    let normal: SMatrix<f64, TERMS, TERMS> = paper.iter().map(|(_, t)| t * t.transpose()).sum();
    let inverse = normal.try_inverse().filter(|inverse| inverse[(0, 0)] < MAX_LEVERAGE)?;
    let gradient = position.log_gradient(i).map(|g| f64::from(g) / RADIUS as f64);
    // Noise makes the codeword that is continued to here and its slope wrong together.
    let along = SVector::<f64, TERMS>::from([0.0, gradient[0], gradient[1], 0.0, 0.0, 0.0]);
    let spread = inverse * along;
    let value = |j: usize, channel: usize| f64::from(position.values[j * k + channel]);
    let mut sums = [0.0; 2];
    for channel in 0..k {
        let right: SVector<f64, TERMS> = paper.iter().map(|(j, t)| t * value(*j, channel)).sum();
        let c = inverse * right;
        let misfit: f64 = paper.iter().map(|(j, t)| (value(*j, channel) - t.dot(&c)).powi(2)).sum();
        let variance = misfit / (paper.len() - TERMS) as f64 + 1e-8;
        // What is noise on paper is more on what is darker.
        let of_own = variance * (f64::from(brightest / own).powi(2) + inverse[(0, 0)]);
        let (moved, off) = (c.dot(&along), value(i, channel) - c[0]);
        // A stripe's edge lies between.
        if off.abs() > moved.abs() + FAR * of_own.sqrt() {
            continue;
        }
        sums[0] += (moved * moved - variance * along.dot(&spread)) / of_own;
        sums[1] += (moved * off + variance * spread[0]) / of_own;
    }
    Some(sums)
}
