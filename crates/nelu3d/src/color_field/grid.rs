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
            let smooth = self.with_taps(self.cells, Tap::of_own_node);
            for (c, (v, s)) in self.coeffs.iter_mut().zip(values.iter().zip(&smooth.coeffs)) {
                *c += v - s;
            }
        }
    }

    /// Returns the mean of the coefficients along w, `[b][a][k]`.
    pub(super) fn mean_along_w(&self) -> Vec<f32> {
        let ([na, nb, nw], k) = (self.nodes(), self.k);
        let mut mean = vec![0.0f32; nb * na * k];
        mean.par_chunks_mut(k).zip(self.coeffs.par_chunks(nw * k)).for_each(|(mean, column)| {
            for node in column.chunks_exact(k) {
                mean.iter_mut().zip(node).for_each(|(mean, c)| *mean += c / nw as f32);
            }
        });
        mean
    }

    /// Returns the same function on a grid with other numbers of cells, as many or more along each axis: a start for a
    /// fit. Polynomials up to cubic ones stay as they are, and what has as many cells, its coefficients.
    pub fn resampled(&self, cells: [usize; 3]) -> Self {
        self.with_taps(cells, Tap::of_finer_node)
    }

    /// Returns the function on a grid with other cells along w, smoothed a little there: `unit` gives the coordinate of
    /// this grid at one of that grid. Beyond its ends it is what it is there.
    pub(super) fn along_w(&self, cells: usize, unit: impl Fn(f64) -> f64) -> Self {
        let mut out = Self::new([self.cells[0], self.cells[1], cells], self.k);
        let (from, to, k) = (self.cells[2], out.nodes()[2], self.k);
        let tap = |node: usize| Tap::of_value(from, unit((node as f64 - 1.0) / cells as f64) as f32);
        let taps: Vec<Tap> = (0..to).map(tap).collect();
        out.coeffs
            .par_chunks_exact_mut(to * k)
            .zip(self.coeffs.par_chunks_exact((from + 3) * k))
            .for_each(|(out, column)| out.chunks_exact_mut(k).zip(&taps).for_each(|(out, tap)| tap.sum(column, out)));
        out
    }

    /// Returns a grid whose coefficients are sums of this one's: along an axis of `from` cells, of `to` cells then, node
    /// n has `tap(from, to, n)`.
    fn with_taps(&self, cells: [usize; 3], tap: impl Fn(usize, usize, usize) -> Tap) -> Self {
        let mut out = Self::new(cells, self.k);
        let (from, to, k) = (self.nodes(), out.nodes(), self.k);
        let taps: [Vec<Tap>; 3] =
            std::array::from_fn(|i| (0..to[i]).map(|n| tap(self.cells[i], cells[i], n)).collect());
        let column = from[2] * k;
        // Axis by axis: some rows to one, in that some columns to one, in that some nodes to one.
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

/// A weighed sum of neighboring nodes along one of a spline's axes.
struct Tap {
    first: usize,
    weights: Vec<f32>,
}

impl Tap {
    /// The value of a spline of `from` cells at one of its nodes, or at its end for one beyond.
    fn of_own_node(from: usize, _: usize, node: usize) -> Self {
        Self::of_value(from, (node as f32 - 1.0) / from as f32)
    }

    /// The value of a spline of `from` cells at a unit coordinate, or at its end beyond.
    fn of_value(from: usize, unit: f32) -> Self {
        let (cell, position) = lattice::locate([from; 3], [unit; 3]);
        Self { first: cell[0], weights: lattice::weights(position[0]).to_vec() }
    }

    /// The coefficient of a node of `to` cells: of values v at distances of a cell, v − v″/6, which is the inverse of the
    /// spline's values at its nodes for cubic functions. Beyond the ends the last pieces go on.
    fn of_finer_node(from: usize, to: usize, node: usize) -> Self {
        if from == to {
            return Self { first: node, weights: vec![1.0] };
        }
        let cell_of = from as f64 / to as f64;
        let places = [-1.0, 0.0, 1.0].map(|d| (node as f64 - 1.0 + d) * cell_of);
        let cells = places.map(|x| (x.max(0.0) as usize).min(from - 1));
        let mut weights = vec![0.0; cells[2] - cells[0] + 4];
        for ((x, cell), part) in places.into_iter().zip(cells).zip([-1.0 / 6.0, 8.0 / 6.0, -1.0 / 6.0]) {
            for (sum, weight) in weights[cell - cells[0]..].iter_mut().zip(lattice::weights(x - cell as f64)) {
                *sum += part * weight;
            }
        }
        Self { first: cells[0], weights: weights.into_iter().map(|w| w as f32).collect() }
    }

    /// Writes the weighed sum of runs of the length of `to`.
    fn sum(&self, from: &[f32], to: &mut [f32]) {
        let n = to.len();
        let mut terms = self.weights.iter().zip(from[self.first * n..].chunks_exact(n));
        if let Some((weight, run)) = terms.next() {
            to.iter_mut().zip(run).for_each(|(to, x)| *to = weight * x);
        }
        for (weight, run) in terms {
            to.iter_mut().zip(run).for_each(|(to, x)| *to += weight * x);
        }
    }
}
