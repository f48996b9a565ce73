//! Form `grid`: a cubic B-spline over the unit cube of a [`FieldFrame`](super::frame::FieldFrame), fitted by least
//! squares.

use nelu3d_field::lattice::{Lattice, LatticeEvaluator};
use rayon::prelude::*;

/// A uniform tricubic B-spline of `k` channels on `[0, 1]^3`. Nodes are stored `[b][a][w][k]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Cells along a, b and w.
    pub cells: [usize; 3],
    /// Pattern channels.
    pub k: usize,
    /// Coefficients, `(cells_b + 3) × (cells_a + 3) × (cells_w + 3) × k`.
    pub coeffs: Vec<f32>,
}

impl Grid {
    /// Makes a grid of zeros.
    pub fn new(cells: [usize; 3], k: usize) -> Self {
        let n: usize = cells.iter().map(|c| c + 3).product();
        Self { cells, k, coeffs: vec![0.0; n * k] }
    }

    /// Returns the number of nodes along a, b and w.
    pub fn nodes(&self) -> [usize; 3] {
        self.cells.map(|c| c + 3)
    }

    /// Returns the grid as a spline to be evaluated.
    #[inline(always)]
    pub fn lattice(&self) -> Lattice<'_> {
        Lattice { cells: self.cells, k: self.k, nodes: &self.coeffs }
    }

    /// Evaluates c at unit coordinates `q` (clamped to the cube), into `out` (k values).
    #[inline]
    pub fn eval(&self, q: [f32; 3], out: &mut [f32]) {
        LatticeEvaluator::new(self.lattice()).eval(q, out);
    }

    /// Evaluates c and its derivative in the direction `dq`, into `out` and `dout` (k values each).
    pub fn eval_along(&self, q: [f32; 3], dq: [f32; 3], out: &mut [f32], dout: &mut [f32]) {
        LatticeEvaluator::new(self.lattice()).eval_along(q, dq, out, dout);
    }

    /// Sets the coefficients so that the spline passes through `values` at its nodes (`[b][a][w][k]`), by Richardson
    /// iteration on the node-to-node smoothing of the spline, which is a contraction.
    pub fn interpolate(&mut self, values: &[f32]) {
        assert_eq!(values.len(), self.coeffs.len());
        self.coeffs.copy_from_slice(values);
        for _ in 0..5 {
            let smooth = self.resampled(self.cells);
            for (c, (v, s)) in self.coeffs.iter_mut().zip(values.iter().zip(&smooth.coeffs)) {
                *c += v - s;
            }
        }
    }

    /// Returns the same function on a grid with other numbers of cells, sampled at the new nodes: a start for a fit.
    pub fn resampled(&self, cells: [usize; 3]) -> Self {
        let mut out = Self::new(cells, self.k);
        let [na, _, nw] = out.nodes();
        let k = self.k;
        out.coeffs.par_chunks_mut(na * nw * k).enumerate().for_each(|(b, row)| {
            for a in 0..na {
                for w in 0..nw {
                    let at = |i: usize, n: usize| (i as f32 - 1.0) / n as f32;
                    let q = [at(a, cells[0]), at(b, cells[1]), at(w, cells[2])];
                    self.eval(q, &mut row[(a * nw + w) * k..][..k]);
                }
            }
        });
        out
    }
}
