//! The penalty on second differences of the spline's coefficients, Σ over axes of λ DᵀD, and on first differences along
//! w.

use rayon::prelude::*;

use super::smoothness::Smoothness;
use crate::color_field::grid::Grid;

/// The operator λ DᵀD of a grid, with D the second differences along each axis.
pub(super) struct Penalty {
    nodes: [usize; 3],
    k: usize,
    /// Per axis and index, coefficients of the neighbors −2 … 2, multiplied by the weight of the axis.
    stencils: [Vec<[f32; 5]>; 3],
    /// λ of every value of a column of nodes.
    lambda: Vec<f32>,
}

/// Returns the rows of DᵀD for a chain of `n` nodes, where D has a row per inner node.
fn stencil(n: usize, strength: f32) -> Vec<[f32; 5]> {
    let mut rows = vec![[0.0; 5]; n];
    for mid in 1..n.saturating_sub(1) {
        let d = [1.0, -2.0, 1.0];
        for i in 0..3 {
            for j in 0..3 {
                rows[mid - 1 + i][2 + j - i] += strength * d[i] * d[j];
            }
        }
    }
    rows
}

/// Adds rows of DᵀD of first differences.
fn add_slopes(rows: &mut [[f32; 5]], strength: f32) {
    for i in 1..rows.len() {
        rows[i - 1][2] += strength;
        rows[i - 1][3] -= strength;
        rows[i][2] += strength;
        rows[i][1] -= strength;
    }
}

impl Penalty {
    /// Prepares the penalty of a grid with `lambda` per channel.
    pub(super) fn new(grid: &Grid, smooth: Smoothness, lambda: &[f32]) -> Self {
        let nodes @ [na, nb, nw] = grid.nodes();
        let mut stencils = [stencil(na, smooth.across), stencil(nb, smooth.across), stencil(nw, smooth.along)];
        add_slopes(&mut stencils[2], smooth.slope_along);
        let lambda = lambda.iter().copied().cycle().take(nw * grid.k).collect();
        Self { nodes, k: grid.k, stencils, lambda }
    }

    /// Computes y = Σ λ DᵀD x.
    pub(super) fn apply(&self, x: &[f32], y: &mut [f32]) {
        let [na, nb, nw] = self.nodes;
        let column = nw * self.k;
        let row = na * column;
        y.par_chunks_mut(row).enumerate().for_each(|(b, y)| {
            for (a, y) in y.chunks_exact_mut(column).enumerate() {
                let center = b * row + a * column;
                y.fill(0.0);
                // Neighbors two steps away at most, none beyond the ends: their coefficients are 0 there, and clamping
                // keeps the slice in range.
                let mut add = |index: usize, n: usize, step: usize, coeffs: &[f32; 5]| {
                    let at = |o: usize| {
                        let i = (index + o).saturating_sub(2).min(n - 1);
                        &x[center + i * step - index * step..][..column]
                    };
                    let [x0, x1, x2, x3, x4] = [at(0), at(1), at(2), at(3), at(4)];
                    for i in 0..column {
                        y[i] += coeffs[0] * x0[i]
                            + coeffs[1] * x1[i]
                            + coeffs[2] * x2[i]
                            + coeffs[3] * x3[i]
                            + coeffs[4] * x4[i];
                    }
                };
                add(a, na, column, &self.stencils[0][a]);
                add(b, nb, row, &self.stencils[1][b]);
                let x = &x[center..center + column];
                for (w, coeffs) in self.stencils[2].iter().enumerate() {
                    for (o, coeff) in coeffs.iter().enumerate() {
                        let Some(from) = (w + o).checked_sub(2).filter(|from| *from < nw) else { continue };
                        for c in 0..self.k {
                            y[w * self.k + c] += coeff * x[from * self.k + c];
                        }
                    }
                }
                y.iter_mut().zip(&self.lambda).for_each(|(y, l)| *y *= l);
            }
        });
    }
}
