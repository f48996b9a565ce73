//! The samples' part of the normal equations, Bᵀ Ω B: bins of a sweep as samples of the spline, stripe by stripe of its
//! cells. How they are multiplied is in [`nelu3d_field::normal`].

use std::ops::Range;

use nelu3d_field::lattice;
use nelu3d_field::normal::{NodeStrides, Place, Weights, add_product, add_spread};
use rayon::prelude::*;

use crate::color_field::bins::{Bins, Sample, written_zeros};

/// Number of rows of cells that one task owns; stripes of the same parity never touch the same nodes.
const STRIPE: usize = 16;

/// The samples' part of the normal equations of a grid.
pub struct Normal {
    cells: [usize; 3],
    /// Which of the bins' channels.
    channels: Range<usize>,
    /// The samples by stripes of cells, located once for all products.
    located: Vec<Located>,
}

/// The samples in the cells of a stripe.
#[derive(Default)]
struct Located {
    /// Where each sample is, counted from the stripe's first node.
    places: Vec<Place>,
    /// Weights Σω, `[sample][channel]`.
    omegas: Vec<f32>,
}

impl Normal {
    /// Locates the samples in a grid of `cells` for some of their channels.
    pub fn new(cells: [usize; 3], bins: &Bins, channels: Range<usize>) -> Self {
        let mut normal = Self { cells, channels, located: Vec::new() };
        let n_stripes = cells[1].div_ceil(STRIPE);
        normal.located = (0..n_stripes).into_par_iter().map(|stripe| normal.locate(stripe, bins)).collect();
        normal
    }

    /// Returns the number of coefficients.
    pub(super) fn n_coeffs(&self) -> usize {
        (self.cells[1] + 3) * self.strides().row
    }

    /// Returns the distances between neighboring nodes.
    fn strides(&self) -> NodeStrides {
        let [na, _, nw] = self.cells.map(|c| c + 3);
        let k = self.channels.len();
        NodeStrides { k, row: na * nw * k, column: nw * k }
    }

    /// Locates the samples in the cells of a stripe, in the order of their bins.
    fn locate(&self, stripe: usize, bins: &Bins) -> Located {
        let mut located = Located::default();
        self.for_each_in(stripe, bins, |s, place| {
            located.places.push(place);
            located.omegas.extend_from_slice(s.omegas);
        });
        located
    }

    /// Calls `f(sample, where it is)` for every sample in the cells of a stripe.
    fn for_each_in(&self, stripe: usize, bins: &Bins, mut f: impl FnMut(&Sample<'_>, Place)) {
        let cells_per_bin = [0, 1].map(|i| self.cells[i] as f32 / bins.counts()[i] as f32);
        let NodeStrides { k, row, column } = self.strides();
        let cells = stripe * STRIPE..((stripe + 1) * STRIPE).min(self.cells[1]);
        // The rows of bins that may lie in these cells: one more on either side than geometry says.
        let ratio = bins.n_rows() as f64 / self.cells[1] as f64;
        let first = ((cells.start as f64 * ratio) as usize).saturating_sub(1);
        let last = ((cells.end as f64 * ratio) as usize + 2).min(bins.n_rows());
        let mut visit = |s: Sample<'_>| {
            let (cell, position) = lattice::locate(self.cells, s.q);
            if cells.contains(&cell[1]) {
                let base = (cell[1] - cells.start) * row + cell[0] * column + cell[2] * k;
                let spread = [0, 1].map(|i| s.spread[i] * cells_per_bin[i] * cells_per_bin[i]);
                let [omegas, moments] = [s.omegas, s.moments].map(|of_all| &of_all[self.channels.clone()]);
                f(&Sample { omegas, moments, ..s }, Place { base: base as u32, position, spread });
            }
        };
        (first..last).for_each(|b| bins.for_each_in_row(b, &mut visit));
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
    pub fn diagonal(&self) -> Vec<f32> {
        let mut diag = written_zeros(self.n_coeffs());
        self.by_stripes(&mut diag, |stripe, chunk, _| {
            let Located { places, omegas } = &self.located[stripe];
            add_spread(self.strides(), places, omegas, Weights::Squared, chunk);
        });
        diag
    }

    /// Returns Bᵀ Ω L of the samples that were located.
    pub fn right_side(&self, bins: &Bins) -> Vec<f32> {
        let mut out = written_zeros(self.n_coeffs());
        self.by_stripes(&mut out, |stripe, chunk, _| {
            let places = &self.located[stripe].places;
            let mut moments = Vec::with_capacity(places.len() * self.channels.len());
            self.for_each_in(stripe, bins, |s, _| moments.extend_from_slice(s.moments));
            add_spread(self.strides(), places, &moments, Weights::Plain, chunk);
        });
        out
    }

    /// Adds Bᵀ Ω B x to y.
    pub fn apply(&self, x: &[f32], y: &mut [f32]) {
        self.by_stripes(y, |stripe, chunk, first| {
            let Located { places, omegas } = &self.located[stripe];
            add_product(self.strides(), places, omegas, &x[first..], chunk);
        });
    }
}
