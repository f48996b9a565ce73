//! Fast form. Cells, weights and indices are computed for [`GROUP`] points at a time in loops the compiler vectorizes
//! (every function here is inlined into a caller that `pulp` dispatched); the gathers themselves are scalar.

use super::{HashGrid, Level, PRIMES};
use pulp::Arch;

/// Points whose addresses are computed together: one AVX2 register of indices.
pub(crate) const GROUP: usize = 8;

/// Corner indices and weights of [`GROUP`] points, `[corner][point]`. 2-D uses the first four corners.
struct Corners {
    index: [[u32; GROUP]; 8],
    weight: [[f32; GROUP]; 8],
}

/// Position in cells of one axis: (lower vertex, fraction).
#[inline(always)]
fn split(x: f32, resolution: u32) -> (u32, f32) {
    let n = resolution as f32;
    // f32::max(NaN, 0) is 0. Resolutions are at most 2^16, so i32 holds every position.
    let position = x.max(0.0).min(1.0) * n;
    let low = (position as i32).min(resolution as i32 - 1);
    (low as u32, position - low as f32)
}

#[inline(always)]
fn cells<const D: usize>(level: &Level<D>, xs: &[[f32; GROUP]; D]) -> ([[u32; GROUP]; D], [[f32; GROUP]; D]) {
    let mut cell = [[0u32; GROUP]; D];
    let mut fraction = [[0f32; GROUP]; D];
    for a in 0..D {
        for p in 0..GROUP {
            (cell[a][p], fraction[a][p]) = split(xs[a][p], level.resolution[a]);
        }
    }
    (cell, fraction)
}

#[inline(always)]
fn indices<const D: usize>(level: &Level<D>, cell: &[[u32; GROUP]; D], index: &mut [[u32; GROUP]; 8]) {
    // Contribution of the lower and the upper vertex of every axis; a corner combines one of each.
    let mut part = [[[0u32; GROUP]; 2]; D];
    let mut factor = 1u32;
    for a in 0..D {
        if !level.dense {
            factor = PRIMES[a];
        }
        for p in 0..GROUP {
            part[a][0][p] = cell[a][p].wrapping_mul(factor);
            part[a][1][p] = part[a][0][p].wrapping_add(factor);
        }
        if level.dense {
            factor *= level.resolution[a] + 1;
        }
    }
    let mask = level.n_entries as u32 - 1;
    for corner in 0..1 << D {
        for p in 0..GROUP {
            let mut i = part[0][corner & 1][p];
            if level.dense {
                for a in 1..D {
                    i = i.wrapping_add(part[a][corner >> a & 1][p]);
                }
            } else {
                for a in 1..D {
                    i ^= part[a][corner >> a & 1][p];
                }
                i &= mask;
            }
            index[corner][p] = i;
        }
    }
}

#[inline(always)]
fn weights<const D: usize>(fraction: &[[f32; GROUP]; D], weight: &mut [[f32; GROUP]; 8]) {
    for corner in 0..1 << D {
        for p in 0..GROUP {
            let mut w = 1.0;
            for a in 0..D {
                w *= if corner >> a & 1 == 1 { fraction[a][p] } else { 1.0 - fraction[a][p] };
            }
            weight[corner][p] = w;
        }
    }
}

#[inline(always)]
fn corners<const D: usize>(level: &Level<D>, xs: &[[f32; GROUP]; D]) -> Corners {
    let mut c = Corners { index: [[0; GROUP]; 8], weight: [[0.0; GROUP]; 8] };
    let (cell, fraction) = cells(level, xs);
    indices(level, &cell, &mut c.index);
    weights(&fraction, &mut c.weight);
    c
}

/// Up to [`GROUP`] points, transposed; missing ones are at the origin.
#[inline(always)]
fn transpose<const D: usize>(points: &[[f32; D]]) -> [[f32; GROUP]; D] {
    let mut xs = [[0.0; GROUP]; D];
    for (p, x) in points.iter().enumerate().take(GROUP) {
        for a in 0..D {
            xs[a][p] = x[a];
        }
    }
    xs
}

#[inline(always)]
fn encode_level<const D: usize, const F: usize>(
    level: &Level<D>,
    table: &[f32],
    points: &[[f32; D]],
    out: &mut [f32],
    stride: usize,
    column: usize,
) {
    let (entries, _) = table.as_chunks::<F>();
    let entries = &entries[level.offset..][..level.n_entries];
    for (points, out) in points.chunks(GROUP).zip(out.chunks_mut(GROUP * stride)) {
        let c = corners(level, &transpose(points));
        for (p, out) in out.chunks_exact_mut(stride).enumerate().take(points.len()) {
            let mut sum = [0.0; F];
            for corner in 0..1 << D {
                let entry = &entries[c.index[corner][p] as usize];
                for f in 0..F {
                    sum[f] += c.weight[corner][p] * entry[f];
                }
            }
            out[column..column + F].copy_from_slice(&sum);
        }
    }
}

#[inline(always)]
fn jacobian_level<const D: usize, const F: usize>(
    level: &Level<D>,
    table: &[f32],
    points: &[[f32; D]],
    out: &mut [[f32; D]],
    stride: usize,
    column: usize,
) {
    let (entries, _) = table.as_chunks::<F>();
    let entries = &entries[level.offset..][..level.n_entries];
    let mut index = [[0; GROUP]; 8];
    for (points, out) in points.chunks(GROUP).zip(out.chunks_mut(GROUP * stride)) {
        let xs = transpose(points);
        let (cell, fraction) = cells(level, &xs);
        indices(level, &cell, &mut index);
        for (p, out) in out.chunks_exact_mut(stride).enumerate().take(points.len()) {
            let mut sum = [[0.0; D]; F];
            for corner in 0..1 << D {
                let entry = &entries[index[corner][p] as usize];
                for a in 0..D {
                    let mut slope = if corner >> a & 1 == 1 { 1.0 } else { -1.0 };
                    for b in (0..D).filter(|&b| b != a) {
                        slope *= if corner >> b & 1 == 1 { fraction[b][p] } else { 1.0 - fraction[b][p] };
                    }
                    for f in 0..F {
                        sum[f][a] += slope * entry[f];
                    }
                }
            }
            for a in 0..D {
                let inside = (0.0..=1.0).contains(&xs[a][p]);
                let scale = if inside { level.resolution[a] as f32 } else { 0.0 };
                for f in 0..F {
                    out[column + f][a] = sum[f][a] * scale;
                }
            }
        }
    }
}

#[inline(always)]
fn scatter_level<const D: usize, const F: usize>(
    level: &Level<D>,
    points: &[[f32; D]],
    d_out: &[f32],
    stride: usize,
    column: usize,
    gradient: &mut [f32],
    touched: &mut [u64],
) {
    let (gradient, _) = gradient.as_chunks_mut::<F>();
    let gradient = &mut gradient[..level.n_entries];
    let touched = &mut touched[..level.n_entries.div_ceil(64)];
    for (points, d_out) in points.chunks(GROUP).zip(d_out.chunks(GROUP * stride)) {
        let c = corners(level, &transpose(points));
        for (p, d_out) in d_out.chunks_exact(stride).enumerate().take(points.len()) {
            let mut d = [0.0; F];
            d.copy_from_slice(&d_out[column..column + F]);
            for corner in 0..1 << D {
                let i = c.index[corner][p] as usize;
                for f in 0..F {
                    gradient[i][f] += c.weight[corner][p] * d[f];
                }
                touched[i / 64] |= 1 << (i % 64);
            }
        }
    }
}

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

/// [`forward`] for callers that are already dispatched; rows of `out` are `stride` values apart and only the first
/// `n_features` of each are written.
#[inline(always)]
pub(crate) fn forward_inlined<const D: usize>(
    grid: &HashGrid<D>,
    table: &[f32],
    points: &[[f32; D]],
    out: &mut [f32],
    stride: usize,
) {
    for (l, level) in grid.levels().iter().enumerate() {
        let column = l * grid.config().n_features_per_level;
        by_features!(grid, encode_level(level, table, points, out, stride, column));
    }
}

/// [`jacobian`] for callers that are already dispatched.
#[inline(always)]
pub(crate) fn jacobian_inlined<const D: usize>(
    grid: &HashGrid<D>,
    table: &[f32],
    points: &[[f32; D]],
    out: &mut [[f32; D]],
    stride: usize,
) {
    for (l, level) in grid.levels().iter().enumerate() {
        let column = l * grid.config().n_features_per_level;
        by_features!(grid, jacobian_level(level, table, points, out, stride, column));
    }
}

/// Features of many points: `out[point][l·F + f]`. Runs on the calling thread.
pub fn forward<const D: usize>(grid: &HashGrid<D>, table: &[f32], points: &[[f32; D]], out: &mut [f32]) {
    assert_eq!(table.len(), grid.n_params());
    assert_eq!(out.len(), points.len() * grid.n_features());
    Arch::new().dispatch(
        #[inline(always)]
        || forward_inlined(grid, table, points, out, grid.n_features()),
    );
}

/// Derivatives of many points' features: `out[point][l·F + f][axis]`, per unit of x. Runs on the calling thread.
pub fn jacobian<const D: usize>(grid: &HashGrid<D>, table: &[f32], points: &[[f32; D]], out: &mut [[f32; D]]) {
    assert_eq!(table.len(), grid.n_params());
    assert_eq!(out.len(), points.len() * grid.n_features());
    Arch::new().dispatch(
        #[inline(always)]
        || jacobian_inlined(grid, table, points, out, grid.n_features()),
    );
}

/// Adds to one level's `gradient[entry][feature]` and sets the bit of every entry it adds to.
///
/// `d_out[point]` rows are `stride` values apart, all levels in each. One caller owns a level, so nothing is atomic and
/// the order of summation is that of the points, whatever the number of threads.
pub fn scatter<const D: usize>(
    grid: &HashGrid<D>,
    level: usize,
    points: &[[f32; D]],
    d_out: &[f32],
    stride: usize,
    gradient: &mut [f32],
    touched: &mut [u64],
) {
    assert!(stride >= grid.n_features());
    assert!(d_out.len() >= points.len() * stride);
    let column = level * grid.config().n_features_per_level;
    let level = &grid.levels()[level];
    Arch::new().dispatch(
        #[inline(always)]
        || by_features!(grid, scatter_level(level, points, d_out, stride, column, gradient, touched)),
    );
}

/// Adds the gradient of the whole table to `d_table`, levels in parallel, given `d_out[point][l·F + f]`.
pub fn backward<const D: usize>(grid: &HashGrid<D>, points: &[[f32; D]], d_out: &[f32], d_table: &mut [f32]) {
    assert_eq!(d_table.len(), grid.n_params());
    assert_eq!(d_out.len(), points.len() * grid.n_features());
    let n_features = grid.config().n_features_per_level;
    let mut rest = d_table;
    rayon::scope(|scope| {
        for (l, level) in grid.levels().iter().enumerate() {
            let (gradient, tail) = rest.split_at_mut(level.n_entries * n_features);
            rest = tail;
            scope.spawn(move |_| {
                let mut touched = vec![0; level.n_entries.div_ceil(64)];
                scatter(grid, l, points, d_out, grid.n_features(), gradient, &mut touched);
            });
        }
    });
}
