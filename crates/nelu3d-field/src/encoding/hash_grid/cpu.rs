//! Fast form. Cells, weights and indices are computed for [`GROUP`] points at a time in loops the compiler vectorizes
//! (every function here is inlined into a caller that `pulp` dispatched); the gathers themselves are scalar.

// Loops over several arrays with one index are what the vectorizer wants to see.
#![expect(clippy::needless_range_loop)]

use super::{HashGrid, Level, PRIMES};
use crate::prefetch::prefetch;
use pulp::{Arch, Simd, WithSimd};

/// Points whose addresses are computed together: one AVX2 register of indices.
pub(crate) const GROUP: usize = 8;

/// Corner indices and weights of [`GROUP`] points, `[corner][point]`. 2-D uses the first four corners.
struct Corners {
    index: [[u32; GROUP]; 8],
    weight: [[f32; GROUP]; 8],
}

/// Position in cells of one axis: (lower vertex, fraction).
#[inline(always)]
#[expect(clippy::manual_clamp, reason = "f32::clamp would let NaN through")]
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
    let mut factors = PRIMES;
    if level.dense {
        factors = [1; 3];
        for a in 1..D {
            factors[a] = factors[a - 1] * (level.resolution[a - 1] + 1);
        }
    }
    // Axis by axis: every corner so far splits into a lower and an upper one.
    index[0] = [0; GROUP];
    for a in 0..D {
        for corner in 0..1 << a {
            for p in 0..GROUP {
                let lower = cell[a][p].wrapping_mul(factors[a]);
                let upper = lower.wrapping_add(factors[a]);
                let before = index[corner][p];
                if level.dense {
                    index[corner][p] = before.wrapping_add(lower);
                    index[corner | 1 << a][p] = before.wrapping_add(upper);
                } else {
                    index[corner][p] = before ^ lower;
                    index[corner | 1 << a][p] = before ^ upper;
                }
            }
        }
    }
    if !level.dense {
        let mask = level.n_entries as u32 - 1;
        for corner in 0..1 << D {
            for p in 0..GROUP {
                index[corner][p] &= mask;
            }
        }
    }
}

#[inline(always)]
fn weights<const D: usize>(fraction: &[[f32; GROUP]; D], weight: &mut [[f32; GROUP]; 8]) {
    weight[0] = [1.0; GROUP];
    for a in 0..D {
        for corner in 0..1 << a {
            for p in 0..GROUP {
                let before = weight[corner][p];
                weight[corner][p] = before * (1.0 - fraction[a][p]);
                weight[corner | 1 << a][p] = before * fraction[a][p];
            }
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

/// Asks for the entries of a group, while the group before it is being worked on. The upper neighbor along x is most
/// often in the same cache line, dense or hashed.
#[inline(always)]
fn fetch<T>(entries: &[T], c: &Corners, n_axes: usize) {
    for corner in (0..1 << n_axes).step_by(2) {
        for p in 0..GROUP {
            prefetch(entries, c.index[corner][p] as usize);
        }
    }
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
    let mut next = corners(level, &transpose(&points[..GROUP.min(points.len())]));
    for (group, here) in points.chunks(GROUP).enumerate() {
        let c = next;
        let after = &points[((group + 1) * GROUP).min(points.len())..];
        next = corners(level, &transpose(&after[..GROUP.min(after.len())]));
        fetch(entries, &next, D);
        for (p, out) in out[group * GROUP * stride..].chunks_exact_mut(stride).enumerate().take(here.len()) {
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
    let mut next = corners(level, &transpose(&points[..GROUP.min(points.len())]));
    for (group, here) in points.chunks(GROUP).enumerate() {
        let c = next;
        let after = &points[((group + 1) * GROUP).min(points.len())..];
        next = corners(level, &transpose(&after[..GROUP.min(after.len())]));
        fetch(gradient, &next, D);
        for (p, d_out) in d_out[group * GROUP * stride..].chunks_exact(stride).enumerate().take(here.len()) {
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
    struct Forward<'a, const D: usize>(&'a HashGrid<D>, &'a [f32], &'a [[f32; D]], &'a mut [f32]);
    impl<const D: usize> WithSimd for Forward<'_, D> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            forward_inlined(self.0, self.1, self.2, self.3, self.0.n_features());
        }
    }
    assert_eq!(table.len(), grid.n_params());
    assert_eq!(out.len(), points.len() * grid.n_features());
    Arch::new().dispatch(Forward(grid, table, points, out));
}

/// Derivatives of many points' features: `out[point][l·F + f][axis]`, per unit of x. Runs on the calling thread.
pub fn jacobian<const D: usize>(grid: &HashGrid<D>, table: &[f32], points: &[[f32; D]], out: &mut [[f32; D]]) {
    struct Jacobian<'a, const D: usize>(&'a HashGrid<D>, &'a [f32], &'a [[f32; D]], &'a mut [[f32; D]]);
    impl<const D: usize> WithSimd for Jacobian<'_, D> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            jacobian_inlined(self.0, self.1, self.2, self.3, self.0.n_features());
        }
    }
    assert_eq!(table.len(), grid.n_params());
    assert_eq!(out.len(), points.len() * grid.n_features());
    Arch::new().dispatch(Jacobian(grid, table, points, out));
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
    struct Scatter<'a, const D: usize> {
        grid: &'a HashGrid<D>,
        level: usize,
        points: &'a [[f32; D]],
        d_out: &'a [f32],
        stride: usize,
        gradient: &'a mut [f32],
        touched: &'a mut [u64],
    }
    impl<const D: usize> WithSimd for Scatter<'_, D> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self { grid, level, points, d_out, stride, gradient, touched } = self;
            let column = level * grid.config().n_features_per_level;
            let level = &grid.levels()[level];
            by_features!(grid, scatter_level(level, points, d_out, stride, column, gradient, touched));
        }
    }
    assert!(stride >= grid.n_features());
    assert!(d_out.len() >= points.len() * stride);
    Arch::new().dispatch(Scatter { grid, level, points, d_out, stride, gradient, touched });
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
