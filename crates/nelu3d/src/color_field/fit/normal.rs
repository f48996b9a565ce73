//! The samples' part of the normal equations, Bᵀ Ω B, applied without being formed: B evaluates the spline at the bins,
//! each of which is a mean over samples that are spread by variances v along a and b: c + ½ v_a ∂²c/∂a² + ½ v_b ∂²c/∂b².
//!
//! A sample touches 64 nodes: 16 runs of four neighbors along w, which with their channels are 4 k consecutive numbers.
//! All work is on whole runs: 16 multiply-adds of runs to evaluate, 16 to spread. Both loops read and write what the
//! cache holds, as bins are in the order of the nodes.

use nelu3d_field::lattice::{self, weights_by_product};
use rayon::prelude::*;

use crate::color_field::bins::{Bins, Sample};
use crate::color_field::grid::Grid;

/// Number of rows of cells that one task owns; stripes of the same parity never touch the same nodes.
const STRIPE: usize = 16;

/// The samples' part of the normal equations of a grid.
pub(super) struct Normal<'a> {
    bins: &'a Bins,
    cells: [usize; 3],
    k: usize,
    /// The samples by stripes of cells, located once for all products.
    located: Vec<Located>,
}

/// The samples in the cells of a stripe.
#[derive(Default)]
struct Located {
    /// Where each sample is.
    places: Vec<Place>,
    /// Weights Σω, `[sample][channel]`.
    omegas: Vec<f32>,
}

/// Where a sample is, and how far what it stands for reaches around it.
#[derive(Clone, Copy)]
struct Place {
    /// Beginning of the first of its runs, counted from the stripe's.
    base: u32,
    /// Position in its cell, 0..1.
    position: [f32; 3],
    /// Variances of what it is the mean of, along a and b, in squared cells.
    spread: [f32; 2],
}

/// The nodes that a sample touches.
struct Support {
    /// Beginning of the first of the 16 runs.
    base: usize,
    /// Weights of the runs, `[b][a]`.
    across: [[f32; 4]; 4],
    /// Weights along a run.
    along: [f32; 4],
}

/// Distances in memory from one node to the next along b and a.
#[derive(Clone, Copy)]
struct Strides {
    row: usize,
    column: usize,
}

/// Returns the spline weights at a position in a cell: four arrays, one per weight, of one lane per axis, so that the
/// three axes lie side by side in vector registers; the fourth lane is idle. See [`weights_by_product`].
#[inline(always)]
fn lanes(position: [f32; 3]) -> [[f32; 4]; 4] {
    let position = [position[0], position[1], position[2], 0.0];
    let mut w = [[0.0f32; 4]; 4];
    for i in 0..4 {
        let weights = weights_by_product(position[i]);
        for j in 0..4 {
            w[j][i] = weights[j];
        }
    }
    w
}

impl Support {
    /// Returns the support of a sample.
    #[inline(always)]
    fn at(place: Place) -> Self {
        let mut weights = lanes(place.position);
        // A mean over samples: w + ½ v w″.
        for (i, v) in place.spread.into_iter().enumerate() {
            let (x, half) = (place.position[i], 0.5 * v);
            let bends = [1.0 - x, 3.0 * x - 2.0, 1.0 - 3.0 * x, x];
            weights.iter_mut().zip(bends).for_each(|(w, bend)| w[i] += half * bend);
        }
        let (mut along, mut across) = ([0.0; 4], [[0.0; 4]; 4]);
        for i in 0..4 {
            along[i] = weights[i][2];
            for j in 0..4 {
                across[i][j] = weights[i][1] * weights[j][0];
            }
        }
        Self { base: place.base as usize, across, along }
    }
}

/// Computes `run = Σ weight · run of x`. `R` is the length of a run, known to the compiler, or 0.
#[inline(never)]
fn gather<const R: usize>(x: &[f32], strides: Strides, support: &Support, run: &mut [f32]) {
    let len = if R > 0 { R } else { run.len() };
    let run = &mut run[..len];
    run.fill(0.0);
    for (b, across) in support.across.iter().enumerate() {
        let x = &x[support.base + b * strides.row..][..3 * strides.column + len];
        for (a, weight) in across.iter().enumerate() {
            for (sum, x) in run.iter_mut().zip(&x[a * strides.column..][..len]) {
                *sum += weight * x;
            }
        }
    }
}

/// Adds `weight · run` to the runs of y.
#[inline(never)]
fn spread<const R: usize>(y: &mut [f32], strides: Strides, support: &Support, run: &[f32]) {
    let len = if R > 0 { R } else { run.len() };
    let run = &run[..len];
    for (b, across) in support.across.iter().enumerate() {
        let y = &mut y[support.base + b * strides.row..][..3 * strides.column + len];
        for (a, weight) in across.iter().enumerate() {
            for (y, v) in y[a * strides.column..][..len].iter_mut().zip(run) {
                *y += weight * v;
            }
        }
    }
}

/// Calls `$f::<R>` with the length of a run where the compiler should know it, else with 0.
macro_rules! with_run {
    ($k:expr, $self:ident.$f:ident($($arg:expr),*)) => {
        match $k {
            1 => $self.$f::<4>($($arg),*),
            2 => $self.$f::<8>($($arg),*),
            3 => $self.$f::<12>($($arg),*),
            4 => $self.$f::<16>($($arg),*),
            5 => $self.$f::<20>($($arg),*),
            6 => $self.$f::<24>($($arg),*),
            _ => $self.$f::<0>($($arg),*),
        }
    };
}

impl<'a> Normal<'a> {
    /// Locates the samples in a grid.
    pub(super) fn new(grid: &Grid, bins: &'a Bins) -> Self {
        let mut normal = Self { bins, cells: grid.cells, k: grid.k, located: Vec::new() };
        let n_stripes = grid.cells[1].div_ceil(STRIPE);
        normal.located = (0..n_stripes).into_par_iter().map(|stripe| normal.locate(stripe)).collect();
        normal
    }

    /// Returns the distances between neighboring nodes.
    fn strides(&self) -> Strides {
        let [na, _, nw] = self.cells.map(|c| c + 3);
        Strides { row: na * nw * self.k, column: nw * self.k }
    }

    /// Locates the samples in the cells of a stripe, in the order of their bins.
    fn locate(&self, stripe: usize) -> Located {
        let mut located = Located::default();
        self.for_each_in(stripe, |s, place| {
            located.places.push(place);
            located.omegas.extend_from_slice(s.omegas);
        });
        located
    }

    /// Calls `f(sample, where it is)` for every sample in the cells of a stripe.
    fn for_each_in(&self, stripe: usize, mut f: impl FnMut(&Sample<'_>, Place)) {
        let cells_per_bin = [0, 1].map(|i| self.cells[i] as f32 / self.bins.counts()[i] as f32);
        let Strides { row, column } = self.strides();
        let cells = stripe * STRIPE..((stripe + 1) * STRIPE).min(self.cells[1]);
        // The rows of bins that may lie in these cells: one more on either side than geometry says.
        let ratio = self.bins.n_rows() as f64 / self.cells[1] as f64;
        let first = ((cells.start as f64 * ratio) as usize).saturating_sub(1);
        let last = ((cells.end as f64 * ratio) as usize + 2).min(self.bins.n_rows());
        let mut visit = |s: Sample<'_>| {
            let (cell, position) = lattice::locate(self.cells, s.q);
            if cells.contains(&cell[1]) {
                let base = (cell[1] - cells.start) * row + cell[0] * column + cell[2] * self.k;
                let spread = [0, 1].map(|i| s.spread[i] * cells_per_bin[i] * cells_per_bin[i]);
                f(&s, Place { base: base as u32, position, spread });
            }
        };
        (first..last).for_each(|b| self.bins.for_each_in_row(b, &mut visit));
    }

    /// Calls `f(stripe, part of out, beginning of the part)` for every stripe. Stripes of the same parity touch
    /// disjoint rows of nodes, so each parity runs in parallel and the order of additions is fixed.
    fn by_stripes(&self, out: &mut [f32], f: impl Fn(usize, &mut [f32], usize) + Sync) {
        let row = self.strides().row;
        for parity in 0..2 {
            let Some(rest) = out.get_mut(parity * STRIPE * row..) else { continue };
            rest.par_chunks_mut(2 * STRIPE * row).enumerate().for_each(|(i, chunk)| {
                let stripe = 2 * i + parity;
                if stripe < self.located.len() {
                    f(stripe, chunk, stripe * STRIPE * row);
                }
            });
        }
    }

    /// Returns Σ ω b² per coefficient. Precisions of channels differ as their intensities do, at the scale of the
    /// pattern.
    pub(super) fn diagonal(&self) -> Vec<f32> {
        let mut diag = vec![0.0; (self.cells[1] + 3) * self.strides().row];
        with_run!(self.k, self.add_diagonal(&mut diag));
        diag
    }

    fn add_diagonal<const R: usize>(&self, out: &mut [f32]) {
        let (k, strides) = (self.k, self.strides());
        self.by_stripes(out, |stripe, chunk, _| {
            let mut run = vec![0.0; 4 * k];
            let Located { places, omegas } = &self.located[stripe];
            for (place, omegas) in places.iter().zip(omegas.chunks_exact(k)) {
                let mut support = Support::at(*place);
                for (node, w) in run.chunks_exact_mut(k).zip(support.along) {
                    node.iter_mut().zip(omegas).for_each(|(v, o)| *v = w * w * o);
                }
                support.across = support.across.map(|row| row.map(|w| w * w));
                spread::<R>(chunk, strides, &support, &run);
            }
        });
    }

    /// Adds Bᵀ Ω L.
    pub(super) fn add_rhs(&self, out: &mut [f32]) {
        with_run!(self.k, self.add_rhs_run(out));
    }

    fn add_rhs_run<const R: usize>(&self, out: &mut [f32]) {
        let (k, strides) = (self.k, self.strides());
        self.by_stripes(out, |stripe, chunk, _| {
            let mut run = vec![0.0; 4 * k];
            self.for_each_in(stripe, |s, place| {
                let support = Support::at(place);
                for (node, w) in run.chunks_exact_mut(k).zip(support.along) {
                    node.iter_mut().zip(s.moments).for_each(|(v, m)| *v = w * m);
                }
                spread::<R>(chunk, strides, &support, &run);
            });
        });
    }

    /// Adds Bᵀ Ω B x to y.
    pub(super) fn apply(&self, x: &[f32], y: &mut [f32]) {
        with_run!(self.k, self.apply_run(x, y));
    }

    fn apply_run<const R: usize>(&self, x: &[f32], y: &mut [f32]) {
        let k = if R > 0 { R / 4 } else { self.k };
        let strides = self.strides();
        self.by_stripes(y, |stripe, chunk, first| {
            let (mut run, mut value) = (vec![0.0; 4 * k], vec![0.0; k]);
            let (run, value) = (&mut run[..4 * k], &mut value[..k]);
            let Located { places, omegas } = &self.located[stripe];
            for (place, omegas) in places.iter().zip(omegas.chunks_exact(k)) {
                let support = Support::at(*place);
                gather::<R>(&x[first..], strides, &support, run);
                for c in 0..k {
                    let v = (0..4).map(|l| support.along[l] * run[l * k + c]).sum::<f32>();
                    value[c] = v * omegas[c];
                }
                for l in 0..4 {
                    for c in 0..k {
                        run[l * k + c] = support.along[l] * value[c];
                    }
                }
                spread::<R>(chunk, strides, &support, run);
            }
        });
    }
}
