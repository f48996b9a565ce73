//! Fast form. Cells and indices are computed for `GROUP` points at a time in loops the compiler vectorizes (every
//! function here is inlined into a caller that `pulp` dispatched). The gathers are scalar; a point's eight entries are
//! then interpolated axis by axis as one or two vectors, which yields the value and, for a few operations more, its
//! derivatives.

use super::{HashGrid, Level};
use crate::prefetch::prefetch;
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Points whose addresses are computed together: one AVX2 register of indices.
pub(crate) const GROUP: usize = 8;
/// Values of a cache line.
pub(crate) const LINE: usize = 16;
/// Bytes of a level's values below which the second-level cache holds them and asking ahead only costs.
const CACHED: usize = 1 << 18;

/// Where a group of points lies in a level. 2-D uses the first four corners.
struct Cells<const D: usize> {
    /// Entry of every corner, `[corner][point]`.
    index: [[u32; GROUP]; 8],
    /// Position within the cell, `[axis][point]`.
    fraction: [[f32; GROUP]; D],
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
fn cells<const D: usize>(level: &Level<D>, xs: &[[f32; GROUP]; D]) -> Cells<D> {
    let mut cells = Cells { index: [[0; GROUP]; 8], fraction: [[0.0; GROUP]; D] };
    let factors = level.factors();
    // Axis by axis: every corner so far splits into a lower and an upper one. A word holds the brick above the corner's
    // bits, so both are combined at once.
    for a in 0..D {
        let (mut lower, mut upper) = ([0u32; GROUP], [0u32; GROUP]);
        for p in 0..GROUP {
            let vertex;
            (vertex, cells.fraction[a][p]) = split(xs[a][p], level.resolution[a]);
            let word = |v: u32| (v / 2).wrapping_mul(factors[a]) << D | v % 2 << a;
            (lower[p], upper[p]) = (word(vertex), word(vertex + 1));
        }
        for corner in 0..1 << a {
            for p in 0..GROUP {
                let before = cells.index[corner][p];
                if level.dense {
                    cells.index[corner][p] = before.wrapping_add(lower[p]);
                    cells.index[corner | 1 << a][p] = before.wrapping_add(upper[p]);
                } else {
                    cells.index[corner][p] = before ^ lower[p];
                    cells.index[corner | 1 << a][p] = before ^ upper[p];
                }
            }
        }
    }
    if !level.dense {
        let mask = level.n_entries as u32 - 1;
        for corner in 0..1 << D {
            for p in 0..GROUP {
                cells.index[corner][p] &= mask;
            }
        }
    }
    cells
}

/// Up to `GROUP` points, transposed; missing ones are at the origin.
#[inline(always)]
fn transpose<const D: usize>(points: &[[f32; D]]) -> [[f32; GROUP]; D] {
    let mut xs = [[0.0; GROUP]; D];
    if let Some(points) = points.first_chunk::<GROUP>() {
        for p in 0..GROUP {
            for a in 0..D {
                xs[a][p] = points[p][a];
            }
        }
        return xs;
    }
    for (p, x) in points.iter().enumerate() {
        for a in 0..D {
            xs[a][p] = x[a];
        }
    }
    xs
}

/// Asks for the entries of a group, while the group before it is being worked on.
#[inline(always)]
fn fetch<T, const D: usize>(entries: &[T], cells: &Cells<D>) {
    if size_of_val(entries) <= CACHED {
        return;
    }
    for corner in 0..1 << D {
        for p in 0..GROUP {
            prefetch(entries, cells.index[corner][p] as usize);
        }
    }
}

/// Groups of points in order, with the cells of the next one at hand.
struct Groups<'a, const D: usize> {
    level: &'a Level<D>,
    points: &'a [[f32; D]],
    first: usize,
    next: Cells<D>,
}

impl<'a, const D: usize> Groups<'a, D> {
    #[inline(always)]
    fn new(level: &'a Level<D>, points: &'a [[f32; D]]) -> Self {
        Self { level, points, first: 0, next: cells(level, &transpose(points)) }
    }

    /// First point, cells and points of the group; from then on `next` is the one after.
    #[inline(always)]
    fn advance(&mut self) -> Option<(usize, Cells<D>, &'a [[f32; D]])> {
        let rest = self.points.get(self.first..).filter(|rest| !rest.is_empty())?;
        let (here, after) = rest.split_at(GROUP.min(rest.len()));
        let now = std::mem::replace(&mut self.next, cells(self.level, &transpose(after)));
        let first = self.first;
        self.first += GROUP;
        Some((first, now, here))
    }
}

#[inline(always)]
fn subtract<const F: usize>(a: [f32; F], b: [f32; F]) -> [f32; F] {
    std::array::from_fn(|f| a[f] - b[f])
}

#[inline(always)]
fn lerp<const F: usize>(a: [f32; F], b: [f32; F], t: f32) -> [f32; F] {
    std::array::from_fn(|f| a[f] + t * (b[f] - a[f]))
}

/// Value, and slopes by the fraction along each axis, of the multilinear function with these corners.
#[inline(always)]
fn interpolate<const D: usize, const F: usize, const SLOPES: bool>(
    mut v: [[f32; F]; 8],
    t: [f32; D],
) -> ([f32; F], [[f32; F]; D]) {
    let mut slopes = [[[0.0; F]; 4]; D];
    for a in (0..D).rev() {
        let half = 1 << a;
        for corner in 0..half {
            if SLOPES {
                for b in a + 1..D {
                    slopes[b][corner] = lerp(slopes[b][corner], slopes[b][corner + half], t[a]);
                }
                slopes[a][corner] = subtract(v[corner + half], v[corner]);
            }
            v[corner] = lerp(v[corner], v[corner + half], t[a]);
        }
    }
    (v[0], slopes.map(|s| s[0]))
}

/// `jacobian`: of every `every`-th point, `[point / every][axis][stride]`; of none if `every` is 0.
#[inline(always)]
fn encode_level<const D: usize, const F: usize>(
    level: &Level<D>,
    table: &[f32],
    points: &[[f32; D]],
    every: usize,
    out: &mut [f32],
    jacobian: &mut [f32],
    stride: usize,
    column: usize,
) {
    let (entries, _) = table.as_chunks::<F>();
    let entries = &entries[level.offset..][..level.n_entries];
    let mut groups = Groups::new(level, points);
    fetch(entries, &groups.next);
    while let Some((first, cells, here)) = groups.advance() {
        fetch(entries, &groups.next);
        for (p, out) in out[first * stride..].chunks_exact_mut(stride).enumerate().take(here.len()) {
            let mut corners = [[0.0; F]; 8];
            for corner in 0..1 << D {
                corners[corner] = entries[cells.index[corner][p] as usize];
            }
            let t = std::array::from_fn(|a| cells.fraction[a][p]);
            let point = first + p;
            if every > 0 && point.is_multiple_of(every) {
                let (value, slopes) = interpolate::<D, F, true>(corners, t);
                out[column..column + F].copy_from_slice(&value);
                let rows = &mut jacobian[point / every * D * stride..][..D * stride];
                for a in 0..D {
                    let inside = (0.0..=1.0).contains(&here[p][a]);
                    let scale = if inside { level.resolution[a] as f32 } else { 0.0 };
                    rows[a * stride + column..][..F].copy_from_slice(&slopes[a].map(|s| s * scale));
                }
            } else {
                let (value, _) = interpolate::<D, F, false>(corners, t);
                out[column..column + F].copy_from_slice(&value);
            }
        }
    }
}

/// What a level's table receives from each point: d\[f\] · (s · w + u · ∇w) at every corner, w the corner's weight.
#[derive(Clone, Copy)]
pub(crate) struct Incoming<'a> {
    /// d, `[point][feature]` of this level.
    pub(crate) d: &'a [f32],
    /// s, per point; 1 if empty.
    pub(crate) s: &'a [f32],
    /// u, `[axis][point]`, per unit of x; 0 if empty.
    pub(crate) u: [&'a [f32]; 3],
}

/// Factors s · w + u · ∇w of a group, `[corner][point]`.
#[inline(always)]
fn corner_factors<const D: usize>(
    level: &Level<D>,
    cells: &Cells<D>,
    here: &[[f32; D]],
    first: usize,
    incoming: &Incoming,
) -> [[f32; GROUP]; 8] {
    let mut q = [[0.0; GROUP]; 8];
    q[0] = [1.0; GROUP];
    let n = here.len();
    if !incoming.s.is_empty() {
        q[0][..n].copy_from_slice(&incoming.s[first..first + n]);
    }
    if incoming.u[0].is_empty() {
        for a in 0..D {
            for corner in 0..1 << a {
                for p in 0..GROUP {
                    let (before, t) = (q[corner][p], cells.fraction[a][p]);
                    q[corner][p] = before * (1.0 - t);
                    q[corner | 1 << a][p] = before * t;
                }
            }
        }
        return q;
    }
    let xs = transpose(here);
    let mut weight = [[1.0; GROUP]; 8];
    for a in 0..D {
        let mut u = [0.0; GROUP];
        u[..n].copy_from_slice(&incoming.u[a][first..first + n]);
        for p in 0..GROUP {
            let inside = xs[a][p] >= 0.0 && xs[a][p] <= 1.0;
            u[p] = if inside { u[p] * level.resolution[a] as f32 } else { 0.0 };
        }
        for corner in 0..1 << a {
            for p in 0..GROUP {
                let (before, w, t) = (q[corner][p], weight[corner][p], cells.fraction[a][p]);
                q[corner][p] = before * (1.0 - t) - w * u[p];
                q[corner | 1 << a][p] = before * t + w * u[p];
                weight[corner][p] = w * (1.0 - t);
                weight[corner | 1 << a][p] = w * t;
            }
        }
    }
    q
}

#[inline(always)]
fn scatter_level<const D: usize, const F: usize>(
    level: &Level<D>,
    points: &[[f32; D]],
    incoming: &Incoming,
    range: Range<usize>,
    gradient: &mut [f32],
    touched: &mut [u8],
) {
    let (gradient, _) = gradient.as_chunks_mut::<F>();
    let gradient = &mut gradient[..range.len()];
    let touched = &mut touched[..(range.len() * F).div_ceil(LINE)];
    let (d, _) = incoming.d.as_chunks::<F>();
    let d = &d[..points.len()];
    let whole = range.len() == level.n_entries;
    let start = range.start as u32;
    let mut groups = Groups::new(level, points);
    loop {
        if whole {
            fetch(gradient, &groups.next);
        }
        let Some((first, cells, here)) = groups.advance() else { break };
        let q = corner_factors(level, &cells, here, first, incoming);
        for (p, d) in d[first..first + here.len()].iter().enumerate() {
            for corner in 0..1 << D {
                let i = cells.index[corner][p].wrapping_sub(start) as usize;
                // Entries of other owners are theirs to add to.
                if let Some(entry) = gradient.get_mut(i) {
                    for f in 0..F {
                        entry[f] += q[corner][p] * d[f];
                    }
                    touched[i * F / LINE] = 1;
                }
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

/// [`forward`] and [`jacobian`] in one gather, for callers that are already dispatched. Rows of `out` are `stride` values
/// apart, and only the first `n_features` of each are written. `jacobian` is that of every `every`-th point,
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
    for (l, level) in grid.levels().iter().enumerate() {
        let column = l * grid.config().n_features_per_level;
        by_features!(grid, encode_level(level, table, points, every, out, jacobian, stride, column));
    }
}

/// Features of many points: `out[point][l·F + f]`. Runs on the calling thread.
pub fn forward<const D: usize>(grid: &HashGrid<D>, table: &[f32], points: &[[f32; D]], out: &mut [f32]) {
    forward_with_jacobian(grid, table, points, 0, out, &mut []);
}

/// Features of many points, `out[point][l·F + f]`, and their derivatives at every `every`-th point (none if 0):
/// `jacobian[point / every][axis][l·F + f]`, per unit of x. Runs on the calling thread.
pub fn forward_with_jacobian<const D: usize>(
    grid: &HashGrid<D>,
    table: &[f32],
    points: &[[f32; D]],
    every: usize,
    out: &mut [f32],
    jacobian: &mut [f32],
) {
    struct Forward<'a, const D: usize>(
        &'a HashGrid<D>,
        &'a [f32],
        &'a [[f32; D]],
        usize,
        &'a mut [f32],
        &'a mut [f32],
    );
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

/// Adds to the gradient of the entries `range` of one level, `gradient[entry − range.start][feature]`, and sets the mark
/// of every cache line (16 values) it adds to.
///
/// One caller owns an entry, so nothing is atomic, and the order of summation is that of the points, however the table is
/// cut and whatever the number of threads.
pub(crate) fn scatter<const D: usize>(
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
