//! Where points lie in a level, and the entries that they need.

use super::super::Level;
use crate::prefetch::prefetch;

/// Points whose addresses are computed together: one AVX2 register of indices.
pub(crate) const GROUP: usize = 8;
/// Bytes of a level's values below which the second-level cache holds them and asking ahead only costs.
const CACHED: usize = 1 << 18;

/// Groups between the one whose entries are asked for and the one that uses them.
pub(super) const AHEAD: usize = 8;
/// Cells kept: those of the groups on their way.
pub(super) const RING: usize = 16;
/// Where a group of points lies in a level. 2-D uses the first four corners.
#[derive(Clone, Copy)]
pub(super) struct Cells<const D: usize> {
    /// Entry of every corner, `[corner][point]`.
    pub(super) index: [[u32; GROUP]; 8],
    /// Lower vertex, `[axis][point]`.
    pub(super) vertex: [[u32; GROUP]; D],
    /// Position within the cell, `[axis][point]`.
    pub(super) fraction: [[f32; GROUP]; D],
}

impl<const D: usize> Cells<D> {
    /// Returns whether a point lies in this cell.
    #[inline(always)]
    pub(super) fn is_at(&self, p: usize, cell: [u32; D]) -> bool {
        let mut same = true;
        for a in 0..D {
            same &= self.vertex[a][p] == cell[a];
        }
        same
    }

    /// Returns the lower vertex of a point's cell.
    #[inline(always)]
    pub(super) fn vertex_of(&self, p: usize) -> [u32; D] {
        let mut vertex = [0; D];
        for a in 0..D {
            vertex[a] = self.vertex[a][p];
        }
        vertex
    }
}

/// Returns the position in cells of one axis: (lower vertex, fraction).
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

/// Returns the words of the lower and the upper vertex along axis `A`, and the fraction. A word holds the brick above
/// the corner's bits, so that the axes' words, added (dense) or combined by exclusive or (hashed), give the entry.
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

/// Finds the entries of every corner of a group's cells.
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

/// Returns up to `GROUP` points, transposed; missing ones are at the origin.
#[inline(always)]
pub(super) fn transpose<const D: usize>(points: &[[f32; D]]) -> [[f32; GROUP]; D] {
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
    /// Cells of no points.
    pub(super) const NONE: Self = Self { index: [[0; GROUP]; 8], vertex: [[0; GROUP]; D], fraction: [[0.0; GROUP]; D] };

    /// Finds a group's cells and asks for their entries.
    #[inline(always)]
    pub(super) fn locate<T>(&mut self, level: &Level<D>, xs: &[[f32; GROUP]; D], entries: &[T]) {
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
