//! Plain form: one point, one level, one corner at a time.

use super::{HashGrid, Level};
use crate::Real;

/// Returns the cell and the position inside it. The last cell is closed above.
fn locate<T: Real, const D: usize>(level: &Level<D>, x: [T; D]) -> ([u32; D], [T; D]) {
    let mut cell = [0; D];
    let mut fraction = [T::of(0.0); D];
    for a in 0..D {
        let n = T::of(level.resolution[a] as f64);
        let position = x[a].max(T::of(0.0)).min(T::of(1.0)) * n;
        let low = position.floor().min(n - T::of(1.0));
        cell[a] = low.to_f64() as u32;
        fraction[a] = position - low;
    }
    (cell, fraction)
}

/// Calls `visit(entry, weight, d weight / d x)` for the 2^D corners of x's cell.
fn corners<T: Real, const D: usize>(level: &Level<D>, x: [T; D], mut visit: impl FnMut(usize, T, [T; D])) {
    let (cell, fraction) = locate(level, x);
    let one = T::of(1.0);
    for corner in 0..1usize << D {
        let upper = |a: usize| corner >> a & 1 == 1;
        let vertex = std::array::from_fn(|a| cell[a] + upper(a) as u32);
        let along = |a: usize| if upper(a) { fraction[a] } else { one - fraction[a] };
        let weight = (0..D).fold(one, |w, a| w * along(a));
        let slope = std::array::from_fn(|a| {
            if !(x[a] >= T::of(0.0) && x[a] <= one) {
                return T::of(0.0);
            }
            let others = (0..D).filter(|&b| b != a).fold(one, |w, b| w * along(b));
            let sign = if upper(a) { one } else { -one };
            sign * T::of(level.resolution[a] as f64) * others
        });
        visit(level.index(vertex), weight, slope);
    }
}

/// Writes the features of one point: `out[l·F + f]`.
pub fn forward<T: Real, const D: usize>(grid: &HashGrid<D>, table: &[T], x: [T; D], out: &mut [T]) {
    assert_eq!(table.len(), grid.n_params());
    assert_eq!(out.len(), grid.n_features());
    let n_features = grid.config().n_features_per_level;
    for (level, out) in grid.levels().iter().zip(out.chunks_exact_mut(n_features)) {
        out.fill(T::of(0.0));
        corners(level, x, |entry, weight, _| {
            for (f, out) in out.iter_mut().enumerate() {
                *out += weight * table[(level.offset + entry) * n_features + f];
            }
        });
    }
}

/// Adds the gradient of the table to `d_table`, given that of one point's features.
pub fn backward<T: Real, const D: usize>(grid: &HashGrid<D>, x: [T; D], d_out: &[T], d_table: &mut [T]) {
    assert_eq!(d_table.len(), grid.n_params());
    assert_eq!(d_out.len(), grid.n_features());
    let n_features = grid.config().n_features_per_level;
    for (level, d_out) in grid.levels().iter().zip(d_out.chunks_exact(n_features)) {
        corners(level, x, |entry, weight, _| {
            for (f, &d) in d_out.iter().enumerate() {
                d_table[(level.offset + entry) * n_features + f] += weight * d;
            }
        });
    }
}

/// Writes the derivative of one point's features by the point: `out[l·F + f][axis]`, per unit of x.
pub fn jacobian<T: Real, const D: usize>(grid: &HashGrid<D>, table: &[T], x: [T; D], out: &mut [[T; D]]) {
    assert_eq!(table.len(), grid.n_params());
    assert_eq!(out.len(), grid.n_features());
    let n_features = grid.config().n_features_per_level;
    for (level, out) in grid.levels().iter().zip(out.chunks_exact_mut(n_features)) {
        out.fill([T::of(0.0); D]);
        corners(level, x, |entry, _, slope| {
            for (f, out) in out.iter_mut().enumerate() {
                let value = table[(level.offset + entry) * n_features + f];
                for a in 0..D {
                    out[a] += slope[a] * value;
                }
            }
        });
    }
}

/// Adds the gradient of the table to `d_table`, given one point's feature gradients along a direction u: that of
/// Σ_f d_out\[f\] Σ_a u_a ∂feature_f/∂x_a.
pub fn backward_jacobian<T: Real, const D: usize>(
    grid: &HashGrid<D>,
    x: [T; D],
    d_out: &[T],
    u: [T; D],
    d_table: &mut [T],
) {
    assert_eq!(d_table.len(), grid.n_params());
    assert_eq!(d_out.len(), grid.n_features());
    let n_features = grid.config().n_features_per_level;
    for (level, d_out) in grid.levels().iter().zip(d_out.chunks_exact(n_features)) {
        corners(level, x, |entry, _, slope| {
            let along: T = slope.iter().zip(u).map(|(&slope, u)| slope * u).sum();
            for (f, &d) in d_out.iter().enumerate() {
                d_table[(level.offset + entry) * n_features + f] += along * d;
            }
        });
    }
}
