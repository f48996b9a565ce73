//! The penalty on second differences of the spline's coefficients, Σ over axes of λ DᵀD, and on first differences along
//! w.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::smoothness::Smoothness;
use crate::color_field::grid::Grid;

/// Columns of nodes that are worked on together: their values, and those of their neighbors, stay in the first cache.
const BLOCK: usize = 16;

/// The operator λ DᵀD of a grid, with D the second differences along each axis.
pub struct Penalty {
    nodes: [usize; 3],
    k: usize,
    /// Along a and b, per index: coefficients of the second differences about the neighbors −1 … 1, multiplied by the
    /// weight across.
    across: [Vec<[f32; 3]>; 2],
    /// λ along a and b of every value of a block of columns.
    lambda: [Vec<f32>; 2],
    /// Coefficients of the neighbors −2 … 2 along w less the value itself, of every value of a block of columns, λ
    /// included.
    along: [Vec<f32>; 5],
}

/// Returns the rows of DᵀD for a chain of `n` nodes, where D has a row per inner node: what a node takes of itself and of
/// the two before and after it.
pub(super) fn stencil(n: usize, strength: f32) -> Vec<[f32; 5]> {
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

/// Returns, per node of a chain of `n`, what DᵀD takes of the second differences about the node before, the node and
/// the one after it, where D has a row per inner node.
fn second_differences(n: usize, strength: f32) -> Vec<[f32; 3]> {
    let of = |mid: usize, c: f32| if (1..n.saturating_sub(1)).contains(&mid) { c * strength } else { 0.0 };
    (0..n).map(|i| [if i > 0 { of(i - 1, 1.0) } else { 0.0 }, of(i, -2.0), of(i + 1, 1.0)]).collect()
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
    /// Prepares the penalty of a grid, with `lambda` per channel beside the factors of the smoothness.
    pub fn new(grid: &Grid, smooth: &Smoothness, lambda: &[f32]) -> Self {
        let nodes @ [na, nb, nw] = grid.nodes();
        let across = [na, nb].map(|n| second_differences(n, smooth.across));
        let mut rows = stencil(nw, smooth.along);
        add_slopes(&mut rows, smooth.slope_along);
        let of_axis = |axis: usize| smooth.of_channels.iter().zip(lambda).map(move |(f, lambda)| lambda * f[axis]);
        let of_block = |axis: usize| of_axis(axis).collect::<Vec<_>>().repeat(BLOCK * nw);
        let along = std::array::from_fn(|o| {
            let column: Vec<f32> = rows.iter().flat_map(|c| of_axis(2).map(move |lambda| lambda * c[o])).collect();
            column.repeat(BLOCK)
        });
        Self { nodes, k: grid.k, across, lambda: [of_block(0), of_block(1)], along }
    }

    /// Computes y = Σ λ DᵀD x.
    pub fn apply(&self, x: &[f32], y: &mut [f32]) {
        let row = self.nodes[0] * self.nodes[2] * self.k;
        let arch = Arch::new();
        y.par_chunks_mut(row).enumerate().for_each(|(b, y)| arch.dispatch(Row { penalty: self, x, b, y }));
    }

    /// Adds what neighbors along a give to the columns of a row from `first` on.
    #[inline(always)]
    fn add_across_a(&self, row: &[f32], y: &mut [f32], first: usize) {
        let (na, column) = (self.nodes[0], self.nodes[2] * self.k);
        let n = y.len() / column;
        // All but the ends have the same coefficients.
        if first >= 2 && first + n + 2 <= na {
            let from = std::array::from_fn(|o| &row[(first + o - 2) * column..][..n * column]);
            return add_weighed_sum(y, from, &self.across[0][first], &self.lambda[0]);
        }
        for (i, y) in y.chunks_exact_mut(column).enumerate() {
            let a = first + i;
            let from = std::array::from_fn(|o| &row[(a + o).saturating_sub(2).min(na - 1) * column..][..column]);
            add_weighed_sum(y, from, &self.across[0][a], &self.lambda[0]);
        }
    }

    /// Adds what neighbors along w give to columns.
    #[inline(always)]
    fn add_along(&self, x: &[f32], y: &mut [f32]) {
        let k = self.k;
        for (o, coeffs) in self.along.iter().enumerate().filter(|(o, _)| *o != 2) {
            // Neighbors of another column have a coefficient of 0.
            let (to, from) = ((2 * k).saturating_sub(o * k), (o * k).saturating_sub(2 * k));
            let Some(n) = x.len().checked_sub(to.max(from)) else { continue };
            let (y, own, x) = (&mut y[to..][..n], &x[to..][..n], &x[from..][..n]);
            y.iter_mut().zip(x.iter().zip(own)).zip(&coeffs[to..]).for_each(|((y, (x, own)), c)| *y += c * (x - own));
        }
    }
}

/// Row b of the operator's product with x.
struct Row<'a> {
    penalty: &'a Penalty,
    x: &'a [f32],
    b: usize,
    /// Where the row goes, `[a][w][channel]`.
    y: &'a mut [f32],
}

impl WithSimd for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { penalty, x, b, y } = self;
        let ([na, nb, nw], row) = (penalty.nodes, y.len());
        let column = nw * penalty.k;
        // Neighbors two steps away at most, none beyond the ends: their coefficients are 0 there, and clamping keeps
        // the slice in range.
        let rows: [&[f32]; 5] = std::array::from_fn(|o| {
            let at = (b + o).saturating_sub(2).min(nb - 1);
            &x[at * row..][..row]
        });
        let mut first = 0;
        while first < na {
            let n = BLOCK.min(na - first);
            let y = &mut y[first * column..][..n * column];
            let rows_of_block = rows.map(|r| &r[first * column..][..n * column]);
            weighed_sum(y, rows_of_block, &penalty.across[1][b], &penalty.lambda[1]);
            penalty.add_across_a(rows[2], y, first);
            penalty.add_along(&rows[2][first * column..][..n * column], y);
            first += n;
        }
    }
}

/// Writes the sum of the second differences of five slices with coefficients `c`, times `lambda`.
#[inline(always)]
fn weighed_sum(y: &mut [f32], [x0, x1, x2, x3, x4]: [&[f32]; 5], c: &[f32; 3], lambda: &[f32]) {
    for ((((y, l), (x0, x1)), x2), (x3, x4)) in
        y.iter_mut().zip(lambda).zip(x0.iter().zip(x1)).zip(x2).zip(x3.iter().zip(x4))
    {
        *y = l * of_differences([x0, x1, x2, x3, x4], c);
    }
}

/// Adds the sum of the second differences of five slices with coefficients `c`, times `lambda`.
#[inline(always)]
fn add_weighed_sum(y: &mut [f32], [x0, x1, x2, x3, x4]: [&[f32]; 5], c: &[f32; 3], lambda: &[f32]) {
    for ((((y, l), (x0, x1)), x2), (x3, x4)) in
        y.iter_mut().zip(lambda).zip(x0.iter().zip(x1)).zip(x2).zip(x3.iter().zip(x4))
    {
        *y += l * of_differences([x0, x1, x2, x3, x4], c);
    }
}

/// Returns the sum of second differences with coefficients `c`. Differences first: where a penalty is thousands of
/// times what samples weigh, values of neighbors are nearly the same, and products of them with coefficients that
/// cancel would leave rounding that is larger than what samples weigh, along which conjugate gradients diverge.
#[inline(always)]
fn of_differences([x0, x1, x2, x3, x4]: [&f32; 5], c: &[f32; 3]) -> f32 {
    let [e0, e1, e2, e3] = [x1 - x0, x2 - x1, x3 - x2, x4 - x3];
    c[0] * (e1 - e0) + c[1] * (e2 - e1) + c[2] * (e3 - e2)
}
