//! Forward: features and their slopes.

use super::super::{HashGrid, Level};
use super::cells::{AHEAD, Cells, GROUP, RING, transpose};

/// Groups that pass through all levels before the next ones.
const BLOCK: usize = 12;

/// A value for each of a group's points and features: `[point · F + feature]`.
type Lanes<const F: usize> = [[f32; F]; GROUP];

/// The group's values of every corner.
type Corners<const F: usize> = [Lanes<F>; 8];

/// Computes value, and slopes by the fraction along each axis, of the multilinear functions with these corners.
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

/// Where the features of a block go. `jacobian` is that of every `every`-th point, `[point / every][axis][stride]`; of
/// none if `every` is 0.
pub(super) struct Encoded<'a> {
    pub(super) every: usize,
    pub(super) out: &'a mut [f32],
    pub(super) jacobian: &'a mut [f32],
    pub(super) stride: usize,
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

/// Encodes up to `BLOCK` groups of points, `first` the first of them, through all levels.
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

/// Encodes any number of points.
#[inline(always)]
pub(super) fn encode_points<const D: usize, const F: usize>(
    grid: &HashGrid<D>,
    table: &[f32],
    points: &[[f32; D]],
    encoded: &mut Encoded,
) {
    for (b, points) in points.chunks(BLOCK * GROUP).enumerate() {
        encode_block::<D, F>(grid, table, points, b * BLOCK * GROUP, encoded);
    }
}
