//! Form `grid`: a cubic B-spline over the unit cube of a [`FieldFrame`](super::frame::FieldFrame), fitted by least
//! squares.

use nelu3d_field::lattice::{self, Lattice, LatticeEvaluator};
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
        let (from, to, k) = (self.nodes(), out.nodes(), self.k);
        let taps: [Vec<Tap>; 3] = std::array::from_fn(|i| Tap::of_nodes(self.cells[i], cells[i]));
        let column = from[2] * k;
        // Axis by axis: four rows to one, in that four columns to one, in that four nodes to one.
        out.coeffs.par_chunks_mut(to[0] * to[2] * k).zip(&taps[1]).for_each(|(out, tap)| {
            let (mut row, mut values) = (vec![0.0; from[0] * column], vec![0.0; column]);
            tap.sum(&self.coeffs, &mut row);
            for (out, tap) in out.chunks_exact_mut(to[2] * k).zip(&taps[0]) {
                tap.sum(&row, &mut values);
                out.chunks_exact_mut(k).zip(&taps[2]).for_each(|(out, tap)| tap.sum(&values, out));
            }
        });
        out
    }
}

/// Where a spline is evaluated along one of its axes: the first of four nodes, and their weights.
struct Tap {
    first: usize,
    weights: [f32; 4],
}

impl Tap {
    /// Returns the places of the nodes of `to` cells in `from` cells, clamped to these.
    fn of_nodes(from: usize, to: usize) -> Vec<Self> {
        let at = |node: usize| {
            let (cell, position) = lattice::locate([from; 3], [(node as f32 - 1.0) / to as f32; 3]);
            Self { first: cell[0], weights: lattice::weights(position[0]) }
        };
        (0..to + 3).map(at).collect()
    }

    /// Writes the weighed sum of four runs of the length of `to`.
    fn sum(&self, from: &[f32], to: &mut [f32]) {
        let n = to.len();
        let [x0, x1, x2, x3] = std::array::from_fn(|i| &from[(self.first + i) * n..][..n]);
        let [w0, w1, w2, w3] = self.weights;
        for ((((to, x0), x1), x2), x3) in to.iter_mut().zip(x0).zip(x1).zip(x2).zip(x3) {
            *to = w0 * x0 + w1 * x1 + w2 * x2 + w3 * x3;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resampled_has_the_values_at_the_new_nodes() {
        let (from, to, k) = ([3, 5, 2], [7, 4, 3], 3);
        let mut grid = Grid::new(from, k);
        grid.coeffs.iter_mut().enumerate().for_each(|(i, c)| *c = ((i * 7919) % 1000) as f32 * 1e-3);
        let out = grid.resampled(to);
        let ([na, nb, nw], mut expected) = (out.nodes(), vec![0.0; k]);
        for node in 0..na * nb * nw {
            let at = [node / nw % na, node / nw / na, node % nw];
            grid.eval(std::array::from_fn(|i| (at[i] as f32 - 1.0) / to[i] as f32), &mut expected);
            for (c, expected) in out.coeffs[node * k..][..k].iter().zip(&expected) {
                assert!((c - expected).abs() < 1e-6, "{at:?}: {c} {expected}");
            }
        }
    }
}
