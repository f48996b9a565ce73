//! Backward: gradients of a level's entries.

use super::super::Level;
use super::cells::{AHEAD, Cells, GROUP, RING, transpose};
use std::ops::Range;

/// Values of a cache line.
pub(crate) const LINE: usize = 16;

/// What a level's table receives from each point: d\[f\] · (s · w + u · ∇w) at every corner, w the corner's weight.
#[derive(Clone, Copy, Debug)]
pub struct Incoming<'a> {
    /// d, `[point][feature]` of this level.
    pub d: &'a [f32],
    /// s, per point; 1 if empty.
    pub s: &'a [f32],
    /// u, `[axis][point]`, per unit of x; 0 if empty.
    pub u: [&'a [f32]; 3],
}

/// Returns the factors s · w + u · ∇w of a group's corners, `[point][corner]`.
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

/// Splits every corner into a lower and an upper one along axis `A`.
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

/// Adds what the points send back to the entries `range` of a level.
#[inline(always)]
pub(super) fn scatter_level<const D: usize, const F: usize>(
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

/// Adds a cell's sums to its corners' entries and marks their cache lines.
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
