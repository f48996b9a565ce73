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

/// Strengths that are tried.
const FACTORS: [f32; 4] = [1.0, 30.0, 1e3, 1e4];
/// One of so many positions is set aside.
const EVERY: usize = 4;
/// Part of the field's rows that the strip has.
const PART_OF_ROWS: usize = 8;
/// Rows that it has at least, if there are as many.
const MIN_ROWS: usize = 48;

/// The penalties of a frame at strength 1.
pub(super) fn smoothness(center: Center, of_channels: Vec<f32>) -> Smoothness {
    match center {
        Center::Light => Smoothness { across: 3e-4, along: 3e-3, slope_along: 3e-4, of_channels },
        Center::Camera => Smoothness { across: 3e-3, along: 1e-4, slope_along: 0.0, of_channels },
    }
}

/// What is set aside.
pub(super) struct Aside {
    /// Positions of the sweep.
    positions: Vec<usize>,
    /// The strip's rows.
    rows: Range<usize>,
    /// Their samples in the strip and about it.
    samples: Vec<Gathered>,
}

impl Aside {
    /// Sets some of the positions `used` aside, and a strip in the middle of a field of `cells`.
    pub(super) fn new(used: &[usize], cells: [usize; 3]) -> Self {
        let n = (cells[1] / PART_OF_ROWS).max(MIN_ROWS).min(cells[1]);
        let first = (cells[1] - n) / 2;
        let positions = used.iter().skip(1).step_by(EVERY).copied().collect();
        Self { positions, rows: first..first + n, samples: Vec::new() }
    }

    /// Keeps the samples of a position that is set aside.
    pub(super) fn keep(&mut self, position: usize, samples: &Gathered) {
        if self.positions.contains(&position) {
            self.samples.push(samples.around(&self.rows));
        }
    }

    /// Chooses the smoothness of a field that is fitted to `bins`, which have the samples that were set aside, too. `fit`
    /// fits a spline to the bins of the strip, which has so many cells.
    pub(super) fn choose(
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
        let errors = FACTORS.map(|factor| {
            let grid = fit(&strip, cells, &smoothness(center, vec![factor; k]));
            self.squared_errors(&grid, bins.n_rows(), &known)
        });
        let of_channels: Vec<f32> = (0..k).map(|c| best_factor(&errors.each_ref().map(|e| e[c]))).collect();
        tracing::debug!(?of_channels, ?errors, "smoothness");
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

/// Returns the strength at which the squared error is least, from that of each of [`FACTORS`]: at the vertex of the
/// parabola through the least one and its neighbors, in logarithms of both. Factors are far apart, and one that is five
/// times too strong for a code hardly shows where paper is bright, but bends the field where samples are dim.
fn best_factor(errors: &[f64; FACTORS.len()]) -> f32 {
    let at = (0..FACTORS.len()).min_by(|i, j| errors[*i].total_cmp(&errors[*j])).expect("some strength was tried");
    if at == 0 || at + 1 == FACTORS.len() || errors[at] <= 0.0 {
        return FACTORS[at];
    }
    let x: [f64; 3] = std::array::from_fn(|i| f64::from(FACTORS[at + i - 1]).ln());
    let y: [f64; 3] = std::array::from_fn(|i| errors[at + i - 1].ln());
    let (before, after) = ((y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1]));
    let middles = [0.5 * (x[0] + x[1]), 0.5 * (x[1] + x[2])];
    // The slope goes from `before`, which is not positive, to `after`, which is not negative.
    let part = if after > before { -before / (after - before) } else { 0.5 };
    (middles[0] + part * (middles[1] - middles[0])).exp() as f32
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::spline_fit::{OF_MANY, fit_spline};
    use crate::progress::Progress;

    /// The strength lies where the error has its minimum, between those that were tried, or at the end where it falls to.
    #[test]
    fn the_best_strength_lies_between_those_that_are_tried() {
        for best in [60.0f64, 300.0, 3000.0] {
            let error = |factor: f32| 7.0 * (0.1 * (f64::from(factor) / best).ln().powi(2)).exp();
            let found = best_factor(&FACTORS.map(error));
            assert!((f64::from(found) / best - 1.0).abs() < 1e-3, "{best}: {found}");
        }
        assert_eq!(best_factor(&FACTORS.map(f64::from)), FACTORS[0]);
        assert_eq!(best_factor(&FACTORS.map(|f| 1.0 / f64::from(f))), FACTORS[3]);
    }

    /// Of a channel of slow waves and one of fast ones under the same noise, the slow one is smoothed more; what was
    /// set aside is in the bins again.
    #[test]
    fn a_slow_code_is_smoothed_more_than_a_fast_one() {
        let cells = [96, 96, 1];
        let mut bins = Bins::new([96, 96, 4], 2);
        let positions: Vec<usize> = (0..8).collect();
        let mut aside = Aside::new(&positions, cells);
        assert_eq!((aside.positions.as_slice(), aside.rows.clone()), (&[1, 5][..], 24..72));
        let mut state = 3u64;
        let mut unit = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        };
        for p in positions {
            let mut samples = bins.gathered();
            for i in 0..96 * 96 {
                let at = [(i % 96) as f32 + unit(), (i / 96) as f32 + unit()].map(|v| v / 96.0);
                let wave = |periods: f32| 0.5 + 0.5 * (std::f32::consts::TAU * at[0] * periods).cos();
                let mut noisy = |v: f32| v + 0.1 * (unit() + unit() + unit() - 1.5);
                let values = [noisy(wave(1.0)), noisy(wave(20.0))];
                samples.push([at[0], at[1], (p as f32 + 0.5) / 8.0], &values, &[100.0, 100.0]);
            }
            aside.keep(p, &samples);
            bins.add_all(&[samples]);
        }
        assert_eq!(aside.samples.len(), 2);
        let count = |bins: &Bins| {
            let mut sum = 0.0;
            bins.for_each_sample(|_, _, w| sum += f64::from(w[0]));
            sum
        };
        let before = count(&bins);
        let fit = |bins: &Bins, cells: [usize; 3], smooth: &Smoothness| {
            fit_spline(bins, cells, smooth, OF_MANY, &Progress::none())
        };
        let chosen = aside.choose(&mut bins, cells, Center::Light, fit).of_channels;
        assert!(chosen[0] >= 1e3 && chosen[1] <= 30.0, "{chosen:?}");
        assert!((count(&bins) / before - 1.0).abs() < 1e-6);
    }
}
