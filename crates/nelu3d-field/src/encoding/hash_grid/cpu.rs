//! Fast form. `GROUP` points at a time pass through a pipeline of three stages: their entries are computed and asked for;
//! some groups later, when memory has answered, they are copied together in plain loads and stores; and one group later
//! interpolated as whole vectors. The gradient goes the same way back, neighbors in one cell added up first.
//!
//! The stages matter. Used at once, entries are waited for; collected in registers, they cost more in shuffles than
//! everything else together; and a vector read back right after its parts were written waits for them to reach the cache.
//! All loops are plain Rust that the compiler vectorizes; every function is inlined into a caller that `pulp` dispatched.

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
#[derive(Clone, Copy)]
struct Cells<const D: usize> {
    /// Entry of every corner, `[corner][point]`.
    index: [[u32; GROUP]; 8],
    /// Lower vertex, `[axis][point]`.
    vertex: [[u32; GROUP]; D],
    /// Position within the cell, `[axis][point]`.
    fraction: [[f32; GROUP]; D],
}

impl<const D: usize> Cells<D> {
    /// Whether a point lies in this cell.
    #[inline(always)]
    fn is_at(&self, p: usize, cell: [u32; D]) -> bool {
        let mut same = true;
        for a in 0..D {
            same &= self.vertex[a][p] == cell[a];
        }
        same
    }

    #[inline(always)]
    fn vertex_of(&self, p: usize) -> [u32; D] {
        let mut vertex = [0; D];
        for a in 0..D {
            vertex[a] = self.vertex[a][p];
        }
        vertex
    }
}

/// Groups between the one whose entries are asked for and the one that uses them.
const AHEAD: usize = 8;
/// Cells kept: those of the groups on their way.
const RING: usize = 16;
/// Groups that pass through all levels before the next ones.
const BLOCK: usize = 12;

/// Position in cells of one axis: (lower vertex, fraction).
#[inline(always)]
#[expect(clippy::manual_clamp, reason = "f32::clamp would let NaN through")]
fn split(x: f32, n: f32) -> (u32, f32) {
    // f32::max(NaN, 0) is 0.
    let position = x.max(0.0).min(1.0) * n;
    let low = position.floor().min(n - 1.0);
    // An integer below 2^23, added to it, is its low bits: the compiler has no vector form of a checked conversion.
    const SHIFT: f32 = 8_388_608.0;
    ((low + SHIFT).to_bits() & 0x7f_ffff, position - low)
}

/// Words of the lower and the upper vertex along axis `A`, and the fraction. A word holds the brick above the corner's
/// bits, so that the axes' words, added (dense) or combined by exclusive or (hashed), give the entry.
#[inline(always)]
fn axis<const A: usize, const D: usize>(
    level: &Level<D>,
    xs: &[[f32; GROUP]; D],
    cells: &mut Cells<D>,
) -> [[u32; GROUP]; 2] {
    let n = level.resolution[A] as f32;
    // The shift moves the brick above the bits of the corner; a constant one of 2^A moves the corner's bit.
    let factor = level.factors()[A] << D;
    let mut words = [[0; GROUP]; 2];
    for p in 0..GROUP {
        let (vertex, t) = split(xs[A][p], n);
        cells.fraction[A][p] = t;
        cells.vertex[A][p] = vertex;
        words[0][p] = (vertex >> 1).wrapping_mul(factor) | (vertex & 1) << A;
        let upper = vertex + 1;
        words[1][p] = (upper >> 1).wrapping_mul(factor) | (upper & 1) << A;
    }
    words
}

#[inline(always)]
fn cells<const D: usize, const DENSE: bool>(level: &Level<D>, xs: &[[f32; GROUP]; D], cells: &mut Cells<D>) {
    let combine = |a: u32, b: u32| if DENSE { a.wrapping_add(b) } else { a ^ b };
    let mask = if DENSE { u32::MAX } else { level.n_entries as u32 - 1 };
    let x = axis::<0, D>(level, xs, cells);
    let y = axis::<1, D>(level, xs, cells);
    let mut xy = [[0; GROUP]; 4];
    for corner in 0..4 {
        for p in 0..GROUP {
            xy[corner][p] = combine(x[corner & 1][p], y[corner >> 1][p]) & mask;
        }
    }
    if D == 2 {
        cells.index[..4].copy_from_slice(&xy);
        return;
    }
    let z = axis::<2, D>(level, xs, cells);
    for corner in 0..8 {
        for p in 0..GROUP {
            cells.index[corner][p] = combine(xy[corner & 3][p], z[corner >> 2][p]) & mask;
        }
    }
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

impl<const D: usize> Cells<D> {
    const NONE: Self = Self { index: [[0; GROUP]; 8], vertex: [[0; GROUP]; D], fraction: [[0.0; GROUP]; D] };

    /// Finds a group's cells and asks for their entries.
    #[inline(always)]
    fn locate<T>(&mut self, level: &Level<D>, xs: &[[f32; GROUP]; D], entries: &[T]) {
        if level.dense {
            cells::<D, true>(level, xs, self);
        } else {
            cells::<D, false>(level, xs, self);
        }
        if size_of_val(entries) > CACHED {
            for index in &self.index[..1 << D] {
                for &i in index {
                    prefetch(entries, i as usize);
                }
            }
        }
    }
}

/// A value for each of a group's points and features: `[point · F + feature]`.
type Lanes<const F: usize> = [[f32; F]; GROUP];

/// The group's values of every corner.
type Corners<const F: usize> = [Lanes<F>; 8];

/// Value, and slopes by the fraction along each axis, of the multilinear functions with these corners.
#[inline(always)]
fn interpolate<const D: usize, const F: usize, const SLOPES: bool>(
    corners: &Corners<F>,
    fraction: &[Lanes<F>; D],
    value: &mut Lanes<F>,
    slopes: &mut [Lanes<F>; D],
) {
    let v: [&[f32]; 8] = std::array::from_fn(|c| corners[c].as_flattened());
    let t: [&[f32]; D] = std::array::from_fn(|a| fraction[a].as_flattened());
    let value = value.as_flattened_mut();
    if D == 2 {
        for i in 0..GROUP * F {
            let (x0, x1) = (v[1][i] - v[0][i], v[3][i] - v[2][i]);
            let (a, b) = (v[0][i] + t[0][i] * x0, v[2][i] + t[0][i] * x1);
            value[i] = a + t[1][i] * (b - a);
            if SLOPES {
                slopes[0].as_flattened_mut()[i] = x0 + t[1][i] * (x1 - x0);
                slopes[1].as_flattened_mut()[i] = b - a;
            }
        }
        return;
    }
    let [sx, sy, sz] = {
        let mut all = slopes.iter_mut();
        [(); 3].map(|()| all.next().expect("three axes").as_flattened_mut())
    };
    for i in 0..GROUP * F {
        let (tx, ty, tz) = (t[0][i], t[1][i], t[2][i]);
        // Along x: four edges of the cell, then y: two faces.
        let x = [v[1][i] - v[0][i], v[3][i] - v[2][i], v[5][i] - v[4][i], v[7][i] - v[6][i]];
        let a = [v[0][i] + tx * x[0], v[2][i] + tx * x[1], v[4][i] + tx * x[2], v[6][i] + tx * x[3]];
        let y = [a[1] - a[0], a[3] - a[2]];
        let b = [a[0] + ty * y[0], a[2] + ty * y[1]];
        let z = b[1] - b[0];
        value[i] = b[0] + tz * z;
        if SLOPES {
            let x = [x[0] + ty * (x[1] - x[0]), x[2] + ty * (x[3] - x[2])];
            sx[i] = x[0] + tz * (x[1] - x[0]);
            sy[i] = y[0] + tz * (y[1] - y[0]);
            sz[i] = z;
        }
    }
}

/// Where the features of a block go. `jacobian`: of every `every`-th point, `[point / every][axis][stride]`; of none if
/// `every` is 0.
struct Encoded<'a> {
    every: usize,
    out: &'a mut [f32],
    jacobian: &'a mut [f32],
    stride: usize,
}

impl Encoded<'_> {
    /// Writes one level's features of the group whose first point is `first`.
    #[inline(always)]
    fn write<const D: usize, const F: usize>(
        &mut self,
        level: &Level<D>,
        l: usize,
        first: usize,
        here: &[[f32; D]],
        cells: &Cells<D>,
        corners: &Corners<F>,
    ) {
        let Self { every, stride, .. } = *self;
        let column = l * F;
        let (mut value, mut slopes) = ([[0.0; F]; GROUP], [[[0.0; F]; GROUP]; D]);
        let mut fraction = [[[0.0; F]; GROUP]; D];
        for a in 0..D {
            for p in 0..GROUP {
                fraction[a][p] = [cells.fraction[a][p]; F];
            }
        }
        if every > 0 {
            interpolate::<D, F, true>(corners, &fraction, &mut value, &mut slopes);
            // The group's first point that is one of them, then every `every`-th.
            let start = first.next_multiple_of(every);
            for (row, p) in (start - first..here.len()).step_by(every).enumerate() {
                let x = here[p];
                let rows = &mut self.jacobian[(start / every + row) * D * stride..][..D * stride];
                for a in 0..D {
                    let inside = x[a] >= 0.0 && x[a] <= 1.0;
                    let scale = if inside { level.resolution[a] as f32 } else { 0.0 };
                    for f in 0..F {
                        rows[a * stride + column + f] = slopes[a][p][f] * scale;
                    }
                }
            }
        } else {
            interpolate::<D, F, false>(corners, &fraction, &mut value, &mut slopes);
        }
        let rows = self.out[first * stride..].chunks_exact_mut(stride);
        for (value, out) in value.iter().zip(rows).take(here.len()) {
            out[column..column + F].copy_from_slice(value);
        }
    }
}

/// Up to `BLOCK` groups of points, `first` the first of them, through all levels.
#[inline(always)]
fn encode_block<const D: usize, const F: usize>(
    grid: &HashGrid<D>,
    table: &[f32],
    points: &[[f32; D]],
    first: usize,
    encoded: &mut Encoded,
) {
    let (table, _) = table.as_chunks::<F>();
    let levels = grid.levels();
    let n_groups = points.len().div_ceil(GROUP);
    let n_items = levels.len() * n_groups;
    let mut xs = [[[0.0; GROUP]; D]; BLOCK];
    for (xs, points) in xs.iter_mut().zip(points.chunks(GROUP)) {
        *xs = transpose(points);
    }
    let mut ring = [Cells::<D>::NONE; RING];
    let mut corners = [[[[0.0; F]; GROUP]; 8]; 2];
    // An item is a level and a group. Each stage has its own.
    let (mut asked, mut copied, mut written) = ((0, 0), (0, 0), (0, 0));
    let next = |(l, g): (usize, usize)| if g + 1 < n_groups { (l, g + 1) } else { (l + 1, 0) };
    let entries = |l: usize| &table[levels[l].offset..][..levels[l].n_entries];
    for item in 0..n_items + AHEAD + 1 {
        if item < n_items {
            let (l, g) = asked;
            ring[item % RING].locate(&levels[l], &xs[g], entries(l));
            asked = next(asked);
        }
        if item >= AHEAD && item - AHEAD < n_items {
            let entries = entries(copied.0);
            let cells = &ring[(item - AHEAD) % RING];
            for (index, corner) in cells.index.iter().zip(&mut corners[item % 2]).take(1 << D) {
                for (&i, entry) in index.iter().zip(corner) {
                    *entry = entries[i as usize];
                }
            }
            copied = next(copied);
        }
        if item > AHEAD {
            let (l, g) = written;
            let here = &points[g * GROUP..points.len().min((g + 1) * GROUP)];
            let cells = &ring[(item - AHEAD - 1) % RING];
            encoded.write(&levels[l], l, first + g * GROUP, here, cells, &corners[(item + 1) % 2]);
            written = next(written);
        }
    }
}

#[inline(always)]
fn encode_points<const D: usize, const F: usize>(
    grid: &HashGrid<D>,
    table: &[f32],
    points: &[[f32; D]],
    encoded: &mut Encoded,
) {
    for (b, points) in points.chunks(BLOCK * GROUP).enumerate() {
        encode_block::<D, F>(grid, table, points, b * BLOCK * GROUP, encoded);
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

/// Factors s · w + u · ∇w of a group's corners, `[point][corner]`.
#[inline(always)]
fn corner_factors<const D: usize>(
    level: &Level<D>,
    cells: &Cells<D>,
    here: &[[f32; D]],
    first: usize,
    incoming: &Incoming,
) -> [[f32; 8]; GROUP] {
    let n = here.len();
    let mut q = [[0.0; GROUP]; 8];
    q[0] = [1.0; GROUP];
    if !incoming.s.is_empty() {
        q[0][..n].copy_from_slice(&incoming.s[first..first + n]);
    }
    let mut u = [[0.0; GROUP]; D];
    if !incoming.u[0].is_empty() {
        let xs = transpose(here);
        for a in 0..D {
            let n_cells = level.resolution[a] as f32;
            u[a][..n].copy_from_slice(&incoming.u[a][first..first + n]);
            for p in 0..GROUP {
                let inside = (xs[a][p] >= 0.0) & (xs[a][p] <= 1.0);
                u[a][p] = if inside { u[a][p] * n_cells } else { 0.0 };
            }
        }
    }
    // Axis by axis, every corner so far splits into a lower and an upper one.
    let mut weight = [[1.0; GROUP]; 8];
    split_corners::<0, D>(&mut q, &mut weight, &cells.fraction, &u);
    split_corners::<1, D>(&mut q, &mut weight, &cells.fraction, &u);
    if D == 3 {
        split_corners::<2, D>(&mut q, &mut weight, &cells.fraction, &u);
    }
    let mut by_point = [[0.0; 8]; GROUP];
    for p in 0..GROUP {
        for corner in 0..8 {
            by_point[p][corner] = q[corner][p];
        }
    }
    by_point
}

#[inline(always)]
fn split_corners<const A: usize, const D: usize>(
    q: &mut [[f32; GROUP]; 8],
    weight: &mut [[f32; GROUP]; 8],
    fraction: &[[f32; GROUP]; D],
    u: &[[f32; GROUP]; D],
) {
    for corner in 0..1 << A {
        for p in 0..GROUP {
            let (before, w, t) = (q[corner][p], weight[corner][p], fraction[A][p]);
            q[corner][p] = before * (1.0 - t) - w * u[A][p];
            q[corner | 1 << A][p] = before * t + w * u[A][p];
            weight[corner][p] = w * (1.0 - t);
            weight[corner | 1 << A][p] = w * t;
        }
    }
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
    let start = range.start as u32;
    let mut ring = [Cells::<D>::NONE; RING];
    // Neighbors on a ray often share a cell: what they send to its corners, `[feature][corner]`, is added up first.
    let mut sum = [[0.0f32; 8]; F];
    let mut index = [u32::MAX; 8];
    let mut cell = [u32::MAX; D];
    let n_groups = points.len().div_ceil(GROUP);
    for item in 0..n_groups + AHEAD {
        if item < n_groups {
            // Where several owners share a level, the addresses asked for are not its own; asking never faults.
            ring[item % RING].locate(level, &transpose(&points[item * GROUP..]), gradient);
        }
        if item < AHEAD {
            continue;
        }
        let (cells, first) = (&ring[(item - AHEAD) % RING], (item - AHEAD) * GROUP);
        if first >= points.len() {
            break;
        }
        let here = &points[first..points.len().min(first + GROUP)];
        let q = corner_factors(level, cells, here, first, incoming);
        for (p, d) in d[first..first + here.len()].iter().enumerate() {
            if !cells.is_at(p, cell) {
                add_to_corners::<F, D>(&sum, &index, start, gradient, touched);
                sum = [[0.0; 8]; F];
                cell = cells.vertex_of(p);
                for corner in 0..8 {
                    index[corner] = cells.index[corner][p];
                }
            }
            for f in 0..F {
                for corner in 0..8 {
                    sum[f][corner] += q[p][corner] * d[f];
                }
            }
        }
    }
    add_to_corners::<F, D>(&sum, &index, start, gradient, touched);
}

#[inline(always)]
fn add_to_corners<const F: usize, const D: usize>(
    sum: &[[f32; 8]; F],
    index: &[u32; 8],
    start: u32,
    gradient: &mut [[f32; F]],
    touched: &mut [u8],
) {
    for corner in 0..1 << D {
        let i = index[corner].wrapping_sub(start) as usize;
        // Entries of other owners are theirs to add to.
        if let Some(entry) = gradient.get_mut(i) {
            for f in 0..F {
                entry[f] += sum[f][corner];
            }
            touched[i * F / LINE] = 1;
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
    let mut encoded = Encoded { every, out, jacobian, stride };
    by_features!(grid, encode_points(grid, table, points, &mut encoded));
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
