//! The fast form. `GROUP` points at a time pass through a pipeline of three stages: their entries are computed and
//! asked for; some groups later, when memory has answered, they are copied together in plain loads and stores; and one
//! group later interpolated as whole vectors. The gradient goes the same way back, neighbors in one cell added up
//! first.
//!
//! The stages matter. Used at once, entries are waited for; collected in registers, they cost more in shuffles than
//! everything else together; and a vector read back right after its parts were written waits for them to reach the
//! cache. All loops are plain Rust that the compiler vectorizes; every function is inlined into a caller that `pulp`
//! dispatched.

mod cells;
mod gather;
mod scatter;

pub use scatter::Incoming;
pub(crate) use scatter::LINE;

use super::{HashGrid, Level};
use gather::{Encoded, encode_points};
use pulp::{Arch, Simd, WithSimd};
use scatter::scatter_level;
use std::ops::Range;

/// Runs `$f::<D, F>(…)` for the run-time F.
macro_rules! by_features {
    ($grid:expr, $f:ident($($arg:expr),* $(,)?)) => {
        match $grid.config().n_features_per_level {
            1 => $f::<D, 1>($($arg),*),
            2 => $f::<D, 2>($($arg),*),
            4 => $f::<D, 4>($($arg),*),
            _ => $f::<D, 8>($($arg),*),
        }
    };
}

/// Writes features and Jacobian in one gather, for callers that are already dispatched. Rows of `out` are `stride`
/// values apart, and only the first `n_features` of each are written. `jacobian` is that of every `every`-th point,
/// `[point / every][axis][stride]`; with `every` = 0 it is not written.
#[inline(always)]
pub(crate) fn encode_inlined<const D: usize>(
    grid: &HashGrid<D>,
    table: &[f32],
    points: &[[f32; D]],
    every: usize,
    out: &mut [f32],
    jacobian: &mut [f32],
    stride: usize,
) {
    let mut encoded = Encoded { every, out, jacobian, stride };
    by_features!(grid, encode_points(grid, table, points, &mut encoded));
}

/// Writes the features of many points: `out[point][l·F + f]`. Runs on the calling thread.
pub fn forward<const D: usize>(grid: &HashGrid<D>, table: &[f32], points: &[[f32; D]], out: &mut [f32]) {
    forward_with_jacobian(grid, table, points, 0, out, &mut []);
}

/// Writes the features of many points, `out[point][l·F + f]`, and their derivatives at every `every`-th point (none if
/// 0): `jacobian[point / every][axis][l·F + f]`, per unit of x. Runs on the calling thread.
pub fn forward_with_jacobian<const D: usize>(
    grid: &HashGrid<D>,
    table: &[f32],
    points: &[[f32; D]],
    every: usize,
    out: &mut [f32],
    jacobian: &mut [f32],
) {
    struct Forward<'a, const D: usize>(&'a HashGrid<D>, &'a [f32], &'a [[f32; D]], usize, &'a mut [f32], &'a mut [f32]);
    impl<const D: usize> WithSimd for Forward<'_, D> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self(grid, table, points, every, out, jacobian) = self;
            encode_inlined(grid, table, points, every, out, jacobian, grid.n_features());
        }
    }
    assert_eq!(table.len(), grid.n_params());
    assert_eq!(out.len(), points.len() * grid.n_features());
    let n_slopes = if every == 0 { 0 } else { points.len().div_ceil(every) };
    assert_eq!(jacobian.len(), n_slopes * D * grid.n_features());
    Arch::new().dispatch(Forward(grid, table, points, every, out, jacobian));
}

/// Adds to the gradient of the entries `range` of one level, `gradient[entry − range.start][feature]`, and sets the
/// mark of every cache line (16 values) it adds to.
///
/// One caller owns an entry, so nothing is atomic, and the order of summation is that of the points, however the table
/// is cut and whatever the number of threads.
///
/// # Panics
/// If a length does not fit.
pub fn scatter<const D: usize>(
    grid: &HashGrid<D>,
    level: usize,
    points: &[[f32; D]],
    incoming: Incoming,
    range: Range<usize>,
    gradient: &mut [f32],
    touched: &mut [u8],
) {
    struct Scatter<'a, const D: usize> {
        grid: &'a HashGrid<D>,
        level: &'a Level<D>,
        points: &'a [[f32; D]],
        incoming: Incoming<'a>,
        range: Range<usize>,
        gradient: &'a mut [f32],
        touched: &'a mut [u8],
    }
    impl<const D: usize> WithSimd for Scatter<'_, D> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self { grid, level, points, incoming, range, gradient, touched } = self;
            by_features!(grid, scatter_level(level, points, &incoming, range, gradient, touched));
        }
    }
    let level = &grid.levels()[level];
    assert!(range.start <= range.end && range.end <= level.n_entries);
    assert_eq!(incoming.d.len(), points.len() * grid.config().n_features_per_level);
    for x in [incoming.s, incoming.u[0], incoming.u[1], incoming.u[2]] {
        assert!(x.is_empty() || x.len() == points.len());
    }
    Arch::new().dispatch(Scatter { grid, level, points, incoming, range, gradient, touched });
}

/// Adds the gradient of the whole table to `d_table`, levels in parallel, given `d_out[l][point][f]`.
pub fn backward<const D: usize>(grid: &HashGrid<D>, points: &[[f32; D]], d_out: &[f32], d_table: &mut [f32]) {
    backward_with_jacobian(grid, points, d_out, &[], [&[]; 3], d_table);
}

/// Adds the table's gradient of Σ d_out · (s · features + Σ_a u_a ∂features/∂x_a): what a loss of the value (through s)
/// and one of the slopes (through u, its gradient by them; Eq. 6 is one) send back together.
///
/// `d_out[l][point][f]`; `s` per point, or empty for 1; `u[axis][point]`, or empty for 0. Levels run in parallel.
pub fn backward_with_jacobian<const D: usize>(
    grid: &HashGrid<D>,
    points: &[[f32; D]],
    d_out: &[f32],
    s: &[f32],
    u: [&[f32]; 3],
    d_table: &mut [f32],
) {
    assert_eq!(d_table.len(), grid.n_params());
    assert_eq!(d_out.len(), points.len() * grid.n_features());
    let n_features = grid.config().n_features_per_level;
    let mut rest = d_table;
    rayon::scope(|scope| {
        for (l, level) in grid.levels().iter().enumerate() {
            let (gradient, tail) = rest.split_at_mut(level.n_entries * n_features);
            rest = tail;
            scope.spawn(move |_| {
                let mut touched = vec![0; gradient.len().div_ceil(LINE)];
                let d = &d_out[l * points.len() * n_features..][..points.len() * n_features];
                scatter(grid, l, points, Incoming { d, s, u }, 0..level.n_entries, gradient, &mut touched);
            });
        }
    });
}
