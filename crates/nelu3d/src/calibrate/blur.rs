//! Blur of the camera, as edges of ink show it in the codewords.
//!
//! Beside an edge of ink most of a pixel's light comes from the paper, and its codeword is that of a place on it (see
//! [`Blur`]). How far away that is need not be known beforehand: paper tells its codewords and their slopes away from
//! edges; continued to pixels beside an edge, they leave a residual there of slope times shift.
//!
//! Codes that are finer than a polynomial leave a residual as well, and more where their slope is large. How well paper
//! continues a channel shows where nothing is shifted, in the same window a few pixels farther from the ink; channels
//! count by that.

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
/// How much farther from the ink the window lies that tells how well a channel is continued, samples.
const AWAY: f32 = 3.0;
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

/// Information about s², and that times s².
type Told = [f64; 2];

/// Gathers what positions tell of the blur.
#[derive(Clone, Debug, Default)]
pub struct BlurEstimator {
    /// What squares of images tell.
    squares: Vec<Told>,
}

impl BlurEstimator {
    /// Adds a position; only samples for which `on_board` holds are looked at.
    pub fn add(&mut self, position: &Position, on_board: impl Fn(usize) -> bool) {
        let (w, h, k) = (position.width, position.height, position.k);
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
        let mut squares = vec![[0.0; 2]; SQUARES * SQUARES * k];
        let mut misfits = vec![Misfit::default(); k];
        for i in edges.iter().copied().step_by(edges.len().div_ceil(SAMPLES).max(1)) {
            let square = i / w * SQUARES / h * SQUARES + i % w * SQUARES / w;
            add_edge(position, i, &mut squares[square * k..(square + 1) * k], &mut misfits);
        }
        let weights: Vec<f64> = misfits.iter().map(Misfit::weight).collect();
        let all = squares.chunks(k).map(|channels| {
            let sum = |i: usize| channels.iter().zip(&weights).map(|(told, weight)| weight * told[i]).sum();
            [sum(0), sum(1)]
        });
        self.squares.extend(all.filter(|square| *square != [0.0; 2]));
    }

    /// Joins what other positions tell.
    pub fn merge(&mut self, other: &Self) {
        self.squares.extend_from_slice(&other.squares);
    }

    /// Returns the blur: the median of what groups of squares tell, or a typical one where too little is known.
    pub fn finish(&self) -> Blur {
        let mut groups: [Told; GROUPS] = [[0.0; 2]; GROUPS];
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

/// How far codewords that are continued over paper are off, in squares of standard deviations.
#[derive(Clone, Copy, Debug, Default)]
struct Misfit {
    sum: f64,
    windows: f64,
}

impl Misfit {
    /// Returns what a channel counts: noise alone leaves a mean of 1.
    fn weight(&self) -> f64 {
        if self.sum > self.windows { self.windows / self.sum } else { 1.0 }
    }
}

const TERMS: usize = 6;
type Terms = SVector<f64, TERMS>;

/// Paper from which codewords are continued to a sample by a polynomial.
struct Paper {
    samples: Vec<(usize, Terms)>,
    inverse: SMatrix<f64, TERMS, TERMS>,
}

impl Paper {
    /// Takes the samples around `i` for which `is_paper` holds; `None` if they are too few to be continued to it.
    fn new(i: usize, width: usize, is_paper: impl Fn(usize) -> bool) -> Option<Self> {
        let terms = |j: usize| {
            let x = ((j % width) as f64 - (i % width) as f64) / RADIUS as f64;
            let y = ((j / width) as f64 - (i / width) as f64) / RADIUS as f64;
            Terms::from([1.0, x, y, x * x, x * y, y * y])
        };
        let samples: Vec<(usize, Terms)> = around(i, width).filter(|j| is_paper(*j)).map(|j| (j, terms(j))).collect();
        if samples.len() < MIN_PAPER {
            return None;
        }
        let normal: SMatrix<f64, TERMS, TERMS> = samples.iter().map(|(_, t)| t * t.transpose()).sum();
        let inverse = normal.try_inverse().filter(|inverse| inverse[(0, 0)] < MAX_LEVERAGE)?;
        Some(Self { samples, inverse })
    }

    /// Returns the polynomial of a channel's values and the variance of a sample about it.
    fn polynomial(&self, value: impl Fn(usize) -> f64) -> (Terms, f64) {
        let right: Terms = self.samples.iter().map(|(j, t)| t * value(*j)).sum();
        let c = self.inverse * right;
        let misfit: f64 = self.samples.iter().map(|(j, t)| (value(*j) - t.dot(&c)).powi(2)).sum();
        (c, misfit / (self.samples.len() - TERMS) as f64 + 1e-8)
    }

    /// Variance, over that of a sample of paper, of what is continued to the sample.
    fn leverage(&self) -> f64 {
        self.inverse[(0, 0)]
    }
}

/// Samples of the window around `i`.
fn around(i: usize, width: usize) -> impl Iterator<Item = usize> {
    (0..=2 * RADIUS).map(move |y| i - RADIUS * (width + 1) + y * width).flat_map(|row| row..=row + 2 * RADIUS)
}

/// Adds to each channel what a sample at an edge tells, and how well paper continues it.
fn add_edge(position: &Position, i: usize, channels: &mut [Told], misfits: &mut [Misfit]) -> Option<()> {
    let (w, k) = (position.width, position.k);
    let brightest = around(i, w).map(|j| position.mean_contrast_at(j)).fold(0.0, f32::max);
    let own = position.mean_contrast_at(i);
    if own < LEAST * brightest || !position.is_wholly_usable(i) {
        return None;
    }
    let is_even = |j: usize| {
        let [x, y] = position.log_gradient(j);
        x * x + y * y < EVEN * EVEN
    };
    let is_paper =
        |j: usize| position.mean_contrast_at(j) >= PAPER * brightest && position.is_wholly_usable(j) && is_even(j);
    let paper = Paper::new(i, w, is_paper)?;
    add_misfits(position, i, is_paper, misfits);
    let gradient = position.log_gradient(i).map(|g| f64::from(g) / RADIUS as f64);
    let value = |j: usize, channel: usize| f64::from(position.values[j * k + channel]);
    // Noise makes the codeword that is continued to here and its slope wrong together.
    let along = Terms::from([0.0, gradient[0], gradient[1], 0.0, 0.0, 0.0]);
    let spread = paper.inverse * along;
    for (channel, told) in channels.iter_mut().enumerate() {
        let (c, variance) = paper.polynomial(|j| value(j, channel));
        // What is noise on paper is more on what is darker.
        let of_own = variance * (f64::from(brightest / own).powi(2) + paper.leverage());
        let (moved, off) = (c.dot(&along), value(i, channel) - c[0]);
        // A stripe's edge lies between.
        if off.abs() > moved.abs() + FAR * of_own.sqrt() {
            continue;
        }
        told[0] += (moved * moved - variance * along.dot(&spread)) / of_own;
        told[1] += (moved * off + variance * spread[0]) / of_own;
    }
    Some(())
}

/// Adds to each channel how far it is off where the window of an edge at `i` lies wholly on paper.
fn add_misfits(position: &Position, i: usize, is_paper: impl Fn(usize) -> bool, misfits: &mut [Misfit]) -> Option<()> {
    let (w, k) = (position.width, position.k);
    let gradient = position.log_gradient(i);
    let steps = gradient.map(|g| (AWAY * g / gradient[0].hypot(gradient[1])).round() as isize);
    let beyond = |j: usize| j.wrapping_add_signed(steps[1] * w as isize + steps[0]);
    let is_inside = |at: usize, by: isize, size: usize| (RADIUS..size - RADIUS).contains(&at.wrapping_add_signed(by));
    if !is_inside(i % w, steps[0], w) || !is_inside(i / w, steps[1], position.height) || !is_paper(beyond(i)) {
        return None;
    }
    // What is missing here is missing there: the same samples are continued as far.
    let paper = Paper::new(i, w, |j| is_paper(j) && is_paper(beyond(j)))?;
    for (channel, misfit) in misfits.iter_mut().enumerate() {
        let value = |j: usize| f64::from(position.values[beyond(j) * k + channel]);
        let (c, variance) = paper.polynomial(value);
        misfit.sum += (value(i) - c[0]).powi(2) / (variance * (1.0 + paper.leverage()));
        misfit.windows += 1.0;
    }
    Some(())
}
