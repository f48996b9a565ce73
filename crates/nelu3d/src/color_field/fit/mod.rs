//! Fitting the spline to the binned sweep: weighted least squares with a second-difference penalty, by conjugate
//! gradients with a preconditioner that solves for whole lines of coefficients. Channels are problems of their own, and
//! each takes its own steps.
//!
//! With a diagonal preconditioner most of the smoothness that was asked for was never reached: stripes under a penalty
//! of thousands of times what samples weigh need thousands of steps of one node. A preconditioner of tensor-product
//! mass matrices reaches the objective in one or two steps where samples are dense, but is far off where they end.

#[doc(hidden)]
pub mod defocus;
#[doc(hidden)]
pub mod light_shift;
#[doc(hidden)]
pub mod lines;
mod modes;
#[doc(hidden)]
pub mod normal;
#[doc(hidden)]
pub mod penalty;
mod smoothness;

use std::ops::Range;

use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::bins::Bins;
use super::grid::Grid;
use crate::progress::Progress;
use defocus::Laplacian;
use lines::Lines;
use normal::Normal;
use penalty::Penalty;
pub use smoothness::Smoothness;

/// The least-squares problem of a spline of given cells and binned samples, ready for any smoothness.
pub struct LeastSquares {
    normal: Normal,
    /// The samples' part of the normal equations' diagonal.
    diagonal: Vec<f32>,
    right_side: Vec<f32>,
    /// Mean weight of a node, channel by channel: the unit of the penalties.
    lambda: Vec<f32>,
}

impl LeastSquares {
    /// Prepares to fit a spline of `cells` to samples.
    pub fn new(cells: [usize; 3], bins: &Bins) -> Self {
        Self::of_channels(cells, bins, 0..bins.k())
    }

    /// Prepares to fit a spline of `cells` to some channels of samples.
    pub fn of_channels(cells: [usize; 3], bins: &Bins, channels: Range<usize>) -> Self {
        let k = channels.len();
        let normal = Normal::new(cells, bins, channels);
        let diagonal = normal.diagonal();
        let lambda = mean_node_weight(&diagonal, k);
        let right_side = normal.right_side(bins);
        Self { normal, diagonal, right_side, lambda }
    }

    /// Returns the number of channels.
    pub fn k(&self) -> usize {
        self.lambda.len()
    }

    /// Improves a spline by conjugate gradients. Deterministic for any number of threads.
    pub fn solve(&self, grid: &mut Grid, smooth: &Smoothness, iterations: usize, progress: &Progress) {
        let (diagonal, r) = (self.diagonal.clone(), self.right_side.clone());
        descend(grid, (&self.normal, diagonal, r, &self.lambda), smooth, iterations, progress);
    }

    /// Returns the normal equations of how much of some `changes` of a spline there is, each given as coefficients:
    /// about a spline that was fitted with `smooth`, and where it follows every change as `smooth` says, by so many
    /// steps.
    pub fn equations_of<const N: usize>(
        &self,
        grid: &Grid,
        changes: &[Vec<f32>; N],
        smooth: &Smoothness,
        iterations: usize,
        progress: &Progress,
    ) -> NormalEquations<N> {
        let k = grid.k;
        let product = |x: &[f32]| {
            let mut y = vec![0.0f32; x.len()];
            self.normal.apply(x, &mut y);
            y
        };
        let residuals: Vec<f32> = {
            let fitted = product(&grid.coeffs);
            self.right_side.iter().zip(fitted).map(|(r, y)| r - y).collect()
        };
        let penalty = Penalty::new(grid, smooth, &self.lambda);
        let lines = Lines::new(grid.nodes(), self.diagonal.clone(), smooth, &self.lambda);
        let apply = |x: &[f32], y: &mut [f32]| {
            penalty.apply(x, y);
            self.normal.apply(x, y);
        };
        let (mut p, mut scratch) = (vec![0.0f32; grid.coeffs.len()], vec![0.0f32; grid.coeffs.len()]);
        // What is left of a change where the spline follows it.
        let left = changes.each_ref().map(|change| {
            let (mut followed, mut r) = (Grid::new(grid.cells, k), product(change));
            conjugate_gradients(apply, &lines, (&mut followed, &mut r), (&mut p, &mut scratch), iterations, progress);
            // The samples' product of what is left: residuals, in which the penalty is counted as well.
            penalty.apply(&followed.coeffs, &mut scratch);
            r.iter_mut().zip(&scratch).for_each(|(r, penalty)| *r += penalty);
            r
        });
        let dot = |a: &[f32], b: &[f32]| dots(a, b, k).into_iter().sum::<f64>();
        NormalEquations {
            left: SMatrix::from_fn(|i, j| 0.5 * (dot(&changes[i], &left[j]) + dot(&changes[j], &left[i]))),
            right: SVector::from_fn(|i, _| dot(&changes[i], &residuals)),
        }
    }

    /// Does what [`Self::solve`] does, in the memory that the problem takes.
    pub fn solve_once(self, grid: &mut Grid, smooth: &Smoothness, iterations: usize, progress: &Progress) {
        let Self { normal, diagonal, right_side, lambda } = self;
        descend(grid, (&normal, diagonal, right_side, &lambda), smooth, iterations, progress);
    }
}

/// Normal equations of `N` numbers.
#[derive(Clone, Copy)]
pub struct NormalEquations<const N: usize> {
    /// Information.
    pub left: SMatrix<f64, N, N>,
    /// Right side.
    pub right: SVector<f64, N>,
}

impl<const N: usize> NormalEquations<N> {
    /// Equations without samples.
    pub fn none() -> Self {
        Self { left: SMatrix::zeros(), right: SVector::zeros() }
    }

    /// Adds equations of numbers that are `m` times these.
    pub fn add(&mut self, other: &Self, m: &SMatrix<f64, N, N>) {
        self.left += m.transpose() * other.left * m;
        self.right += m.transpose() * other.right;
    }

    /// Solves them, with every number held at 0 by some information; `None` where the samples do not tell.
    pub fn solve(&self, held: &SVector<f64, N>) -> Option<SVector<f64, N>> {
        let found = (self.left + SMatrix::from_diagonal(held)).cholesky()?.solve(&self.right);
        found.iter().all(|v| v.is_finite()).then_some(found)
    }
}

/// Steps that follow where patterns go out of focus in a known way: what the defocus makes of them is told by the
/// spline without it.
const REFOCUSED: usize = 3;

/// Conjugate gradients from `grid`'s coefficients. `r` is the right side, and becomes the residuals. With a defocus,
/// the spline is fitted without at first; what the defocus makes of it is taken off the samples then, what is left is
/// fitted, and in the end it is added to the spline.
fn descend(
    grid: &mut Grid,
    (normal, diagonal, mut r, lambda): (&Normal, Vec<f32>, Vec<f32>, &[f32]),
    smooth: &Smoothness,
    iterations: usize,
    progress: &Progress,
) {
    assert_eq!(grid.k, lambda.len());
    let penalty = Penalty::new(grid, smooth, lambda);
    let lines = Lines::new(grid.nodes(), diagonal, smooth, lambda);

    // The penalty overwrites, the samples add.
    let apply = |x: &[f32], y: &mut [f32]| {
        penalty.apply(x, y);
        normal.apply(x, y);
    };
    let mut scratch = vec![0.0f32; grid.coeffs.len()];
    apply(&grid.coeffs, &mut scratch);
    r.par_iter_mut().zip(&scratch).for_each(|(r, a)| *r -= a);
    let mut p = vec![0.0f32; scratch.len()];
    conjugate_gradients(apply, &lines, (grid, &mut r), (&mut p, &mut scratch), iterations, progress);
    if let Some(defocus) = &smooth.defocus {
        let laplacian = Laplacian::of(grid, defocus);
        scratch.fill(0.0);
        laplacian.add(defocus, -1.0, &mut scratch);
        normal.apply(&scratch, &mut r);
        conjugate_gradients(apply, &lines, (grid, &mut r), (&mut p, &mut scratch), REFOCUSED, progress);
        laplacian.add(defocus, 1.0, &mut grid.coeffs);
    }
}

/// Takes steps of conjugate gradients from a spline with residuals `r`, with room for the direction and its product.
fn conjugate_gradients(
    apply: impl Fn(&[f32], &mut [f32]),
    lines: &Lines,
    (grid, r): (&mut Grid, &mut [f32]),
    (p, scratch): (&mut [f32], &mut [f32]),
    iterations: usize,
    progress: &Progress,
) {
    let k = grid.k;
    lines.solve(r, scratch);
    p.copy_from_slice(scratch);
    let mut rz = dots(r, p, k);
    let first = rz.clone();
    for _ in 0..iterations {
        let is_solved = |c: usize| rz[c] <= 1e-9 * first[c] || rz[c] <= 0.0;
        if (0..k).all(is_solved) || progress.cancelled() {
            break;
        }
        apply(p, scratch);
        let curvature = dots(p, scratch, k);
        let is_still = |c: usize| is_solved(c) || curvature[c] <= 0.0;
        let steps: Vec<f32> = (0..k).map(|c| if is_still(c) { 0.0 } else { (rz[c] / curvature[c]) as f32 }).collect();
        step((&mut grid.coeffs, r), (p, scratch), &steps);
        let z = &mut *scratch;
        lines.solve(r, z);
        let next = dots(r, z, k);
        let betas: Vec<f32> = (0..k).map(|c| if is_solved(c) { 0.0 } else { (next[c] / rz[c]) as f32 }).collect();
        let betas = of_some_nodes(&betas);
        p.par_chunks_mut(k * BLOCK).zip(z.par_chunks(k * BLOCK)).for_each(|(p, z)| {
            for (p, z) in p.chunks_mut(betas.len()).zip(z.chunks(betas.len())) {
                p.iter_mut().zip(z).zip(&betas).for_each(|((p, z), b)| *p = z + b * *p);
            }
        });
        rz = next;
    }
}

/// Returns the mean weight per channel of the nodes that samples touch: that of a typical node.
fn mean_node_weight(diag: &[f32], k: usize) -> Vec<f32> {
    let mut sums = vec![(0.0f64, 0u64); k];
    for node in diag.chunks_exact(k) {
        for (s, d) in sums.iter_mut().zip(node).filter(|(_, d)| **d > 0.0) {
            *s = (s.0 + f64::from(*d), s.1 + 1);
        }
    }
    sums.iter().map(|(sum, n)| if *n > 0 { (sum / *n as f64) as f32 } else { 1.0 }).collect()
}

/// Nodes that are summed together, in the same order whatever the number of threads.
const BLOCK: usize = 1 << 12;
/// Nodes whose sums are kept apart, so that the processor adds several at once.
const NODES: usize = 8;

/// Returns what is one value per channel for some nodes in a row.
fn of_some_nodes(of_channels: &[f32]) -> Vec<f32> {
    of_channels.repeat(NODES)
}

/// Returns the sums of `values` of some nodes in a row, channel by channel.
fn by_channel(values: &[f64], k: usize) -> Vec<f64> {
    (0..k).map(|c| values.iter().skip(c).step_by(k).sum()).collect()
}

/// Returns the sums of what blocks have, channel by channel.
fn sum_of_blocks(blocks: &[Vec<f64>], k: usize) -> Vec<f64> {
    (0..k).map(|c| blocks.iter().map(|b| b[c]).sum()).collect()
}

/// Returns the scalar products channel by channel, summed in blocks of a fixed size.
pub fn dots(a: &[f32], b: &[f32], k: usize) -> Vec<f64> {
    let block = |(a, b): (&[f32], &[f32])| {
        let mut sums = vec![0.0f64; NODES * k];
        for (a, b) in a.chunks(NODES * k).zip(b.chunks(NODES * k)) {
            for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
                *sum += f64::from(a * b);
            }
        }
        by_channel(&sums, k)
    };
    let blocks: Vec<_> = a.par_chunks(k * BLOCK).zip(b.par_chunks(k * BLOCK)).map(block).collect();
    sum_of_blocks(&blocks, k)
}

/// Goes steps along `p` from `x`, with residuals `r`, of which steps of 1 take `product` away, one step per channel.
fn step((x, r): (&mut [f32], &mut [f32]), (p, product): (&[f32], &[f32]), steps: &[f32]) {
    let (block, steps) = (steps.len() * BLOCK, of_some_nodes(steps));
    let n = steps.len();
    let go = |to: &mut [f32], along: &[f32], sign: f32| {
        for (to, along) in to.chunks_mut(n).zip(along.chunks(n)) {
            to.iter_mut().zip(along).zip(&steps).for_each(|((to, along), s)| *to += sign * s * along);
        }
    };
    let moved = x.par_chunks_mut(block).zip(p.par_chunks(block));
    moved.zip(r.par_chunks_mut(block).zip(product.par_chunks(block))).for_each(|((x, p), (r, product))| {
        go(x, p, 1.0);
        go(r, product, -1.0);
    });
}
