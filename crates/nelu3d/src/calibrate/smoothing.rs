//! How smooth a field is, channel by channel: what predicts positions best that a fit has not seen.
//!
//! The penalty on second differences that is right is the noise's variance over that of the code's second differences
//! (a ridge regression's), and codes differ: the stripes of a Gray code bend within two pixels, a color film hardly in
//! twenty. With too small a penalty the field follows the sweep's noise, which its values hardly show and its slopes do:
//! depth is error over slope. So some positions are set aside, a strip of the field is fitted without them at several
//! strengths, and every channel takes the one that predicts them best.

use std::ops::Range;

use crate::color_field::bins::{Bins, Gathered};
use crate::color_field::fit::Smoothness;
use crate::color_field::frame::Center;
use crate::color_field::grid::Grid;

/// Factor between strengths that are tried.
pub const RATIO: f32 = 30.0;
/// Strengths that are tried, at most: powers of [`RATIO`] below this one.
pub const MAX_POWER: i32 = 6;
/// What is tried in turn: more smoothness along all axes, across, along w, along b, and along a. Most codes are stripes,
/// along which they do not change.
const LINES: [[i32; 3]; 5] = [[1, 1, 1], [1, 1, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0]];
/// Part by which the squared error has to fall for more smoothness. Noise is most of it, and what the field itself is off
/// by counts where scenes are smooth.
const WORTH: f64 = 1e-3;
/// One of so many positions is set aside.
const EVERY: usize = 4;
/// Part of the field's rows that the strip has.
const PART_OF_ROWS: usize = 8;
/// Rows that it has at least, if there are as many.
const MIN_ROWS: usize = 48;

/// The penalties of a frame at strength 1.
pub(super) fn smoothness(center: Center, of_channels: Vec<[f32; 3]>) -> Smoothness {
    match center {
        Center::Light => Smoothness { across: 3e-4, along: 3e-3, slope_along: 3e-4, of_channels },
        Center::Camera => Smoothness { across: 3e-3, along: 1e-4, slope_along: 0.0, of_channels },
    }
}

/// What is set aside.
pub struct Aside {
    /// Positions of the sweep.
    pub positions: Vec<usize>,
    /// The strip's rows.
    pub rows: Range<usize>,
    /// Their samples in the strip and about it.
    pub samples: Vec<Gathered>,
}

impl Aside {
    /// Sets some of the positions `used` aside, and a strip in the middle of a field of `cells`.
    pub fn new(used: &[usize], cells: [usize; 3]) -> Self {
        let n = (cells[1] / PART_OF_ROWS).max(MIN_ROWS).min(cells[1]);
        let first = (cells[1] - n) / 2;
        let positions = used.iter().skip(1).step_by(EVERY).copied().collect();
        Self { positions, rows: first..first + n, samples: Vec::new() }
    }

    /// Keeps the samples of a position that is set aside.
    pub fn keep(&mut self, position: usize, samples: &Gathered) {
        if self.positions.contains(&position) {
            self.samples.push(samples.around(&self.rows));
        }
    }

    /// Chooses the smoothness of a field that is fitted to `bins`, which have the samples that were set aside, too. `fit`
    /// fits a spline to the bins of the strip, which has so many cells.
    pub fn choose(
        &self,
        bins: &mut Bins,
        cells: [usize; 3],
        center: Center,
        fit: impl Fn(&Bins, [usize; 3], &Smoothness) -> Grid,
    ) -> Smoothness {
        bins.remove_all(&self.samples);
        let strip = bins.window(&self.rows);
        bins.add_all(&self.samples);
        let cells = [cells[0], self.rows.len(), cells[2]];
        let k = bins.k();
        let known = columns_with_samples(&strip);
        let mut searches = vec![Search::default(); k];
        while searches.iter().any(|s| !s.is_done()) {
            let factors = searches.iter().map(Search::next).collect();
            let grid = fit(&strip, cells, &smoothness(center, factors));
            let errors = self.squared_errors(&grid, bins.n_rows(), &known);
            tracing::debug!(factors = ?searches.iter().map(Search::next).collect::<Vec<_>>(), ?errors, "smoothness");
            searches.iter_mut().zip(errors).for_each(|(search, error)| search.take(error));
        }
        let of_channels: Vec<[f32; 3]> = searches.iter().map(Search::best).collect();
        tracing::debug!(?of_channels, "smoothness");
        smoothness(center, of_channels)
    }

    /// Weighted squared errors of a spline of the strip, of a field of `n_rows`, at the samples that were set aside,
    /// channel by channel: where others are known.
    fn squared_errors(&self, grid: &Grid, n_rows: usize, known: &[bool]) -> Vec<f64> {
        let [na, nb, _] = grid.cells;
        let (mut sums, mut c) = (vec![0.0; grid.k], vec![0.0; grid.k]);
        for samples in &self.samples {
            samples.for_each(|q, values, omegas| {
                let b = (q[1] * n_rows as f32 - self.rows.start as f32) / nb as f32;
                let q = [q[0], b, q[2]];
                if q.iter().any(|q| !(0.0..1.0).contains(q)) {
                    return;
                }
                if known[(b * nb as f32) as usize * na + (q[0] * na as f32) as usize] {
                    grid.eval(q, &mut c);
                    for (j, sum) in sums.iter_mut().enumerate() {
                        *sum += f64::from(omegas[j] * (c[j] - values[j]).powi(2));
                    }
                }
            });
        }
        sums
    }
}

/// The search for a channel's strengths: along each of `LINES` for as long as the error falls.
#[derive(Clone, Debug, Default)]
pub struct Search {
    /// Where the line begins: powers of [`RATIO`] along a, b and w.
    start: [i32; 3],
    /// Which of [`LINES`] is searched.
    line: usize,
    /// Errors at the line's start and after it.
    errors: Vec<f64>,
    /// By what the strengths differ from powers, in powers.
    between: [f32; 3],
}

impl Search {
    /// Returns whether all lines have been searched.
    pub fn is_done(&self) -> bool {
        self.line == LINES.len()
    }

    /// Returns the powers of [`RATIO`] after so many steps of the line.
    fn after(&self, steps: usize) -> [i32; 3] {
        let line = LINES.get(self.line).copied().unwrap_or_default();
        [0, 1, 2].map(|i| self.start[i] + line[i] * steps as i32)
    }

    /// Returns the factors to try next; the best ones where the search is done.
    pub fn next(&self) -> [f32; 3] {
        if self.is_done() { self.best() } else { self.after(self.errors.len()).map(|power| RATIO.powi(power)) }
    }

    /// Returns the best factors.
    pub fn best(&self) -> [f32; 3] {
        [0, 1, 2].map(|i| RATIO.powf(self.start[i] as f32 + self.between[i]))
    }

    /// Takes the squared error at what was tried. Where the line has its least error between others, the best strength
    /// is that of the parabola through the three, in logarithms of both: strengths are far apart, and one that is five
    /// times too strong for a code hardly shows where paper is bright, but bends the field where samples are dim.
    pub fn take(&mut self, error: f64) {
        if self.is_done() {
            return;
        }
        self.errors.push(error);
        let n = self.errors.len();
        let falls = n < 2 || error < (1.0 - WORTH) * self.errors[n - 2];
        if falls && self.after(n).into_iter().all(|power| power < MAX_POWER) {
            return;
        }
        let best = if falls { n - 1 } else { n - 2 };
        if !falls && best > 0 && self.errors[best] > 0.0 {
            let [before, here, after] = [best - 1, best, best + 1].map(|i| self.errors[i].max(f64::MIN_POSITIVE).ln());
            let bend = (before - here) + (after - here);
            let vertex = if bend > 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
            for (between, line) in self.between.iter_mut().zip(LINES[self.line]) {
                *between += vertex as f32 * line as f32;
            }
        }
        self.start = self.after(best);
        self.errors = vec![self.errors[best]];
        self.line += 1;
        // At the end of the strengths nothing is left to try.
        while !self.is_done() && self.after(1).into_iter().any(|power| power >= MAX_POWER) {
            self.line += 1;
        }
    }
}

/// Which columns of bins have a sample.
fn columns_with_samples(bins: &Bins) -> Vec<bool> {
    let [na, nb, _] = bins.counts();
    let mut known = vec![false; na * nb];
    for b in 0..nb {
        bins.for_each_in_row(b, |s| known[b * na + ((s.q[0] * na as f32) as usize).min(na - 1)] = true);
    }
    known
}
