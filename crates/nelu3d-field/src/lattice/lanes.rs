//! Many points side by side: cells and weights are computed in lanes. Inlined into functions that are dispatched.

use pulp::Simd;

use super::spline::{slopes, weights_by_product};
use super::view::Lattice;

/// Points side by side.
pub(crate) const LANES: usize = 16;

/// A value per point.
pub(crate) type Lanes = [f32; LANES];

/// Values are rounded to integers by adding this: then the last bits are the integer.
pub(crate) const ROUND: f32 = 8_388_608.0;

/// Room for the sums over the nodes of up to six channels, and for reading a vector from the last of them on.
pub(crate) const SUMS: usize = 32;

/// Returns `a · b + c`, rounded once where the processor that `S` stands for does that in one instruction.
#[inline(always)]
pub(crate) fn mul_add<S: Simd>(a: f32, b: f32, c: f32) -> f32 {
    // Vectors of 256 bits come with it, and every 64-bit Arm has it; elsewhere it would be a call.
    if cfg!(target_arch = "aarch64") || size_of::<S::f32s>() >= 32 { a.mul_add(b, c) } else { a * b + c }
}

/// The place of points in a grid of cells along one axis.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    /// Cells.
    pub(crate) cell: [u32; LANES],
    /// Positions in the cells, in `[0, 1]`.
    pub(crate) position: Lanes,
}

/// Returns the cells of unit coordinates on an axis with `n` cells; those outside are taken to be at its ends.
#[inline(always)]
pub(crate) fn place(q: &Lanes, n: usize) -> Place {
    let (mut cell, mut position) = ([0; LANES], [0.0; LANES]);
    let (n, last) = (n as f32, (n - 1) as f32);
    for l in 0..LANES {
        let u = (q[l] * n).max(0.0).min(n);
        // A coordinate between two cells may be given to either.
        let rounded = (u - 0.5).max(0.0).min(last) + ROUND;
        cell[l] = rounded.to_bits() & 0x7F_FFFF;
        position[l] = u - (rounded - ROUND);
    }
    Place { cell, position }
}

/// Returns the weights of the four nodes around positions in their cells.
#[inline(always)]
pub(crate) fn weights_of(position: &Lanes) -> [Lanes; 4] {
    let mut out = [[0.0; LANES]; 4];
    for l in 0..LANES {
        let w = weights_by_product(position[l]);
        for n in 0..4 {
            out[n][l] = w[n];
        }
    }
    out
}

/// Returns the derivatives of [`weights_of`] by the position, and their derivatives.
#[inline(always)]
pub(crate) fn slopes_of(position: &Lanes) -> [[Lanes; 4]; 2] {
    let mut out = [[[0.0; LANES]; 4]; 2];
    for l in 0..LANES {
        let (f, s) = (position[l], slopes(position[l]));
        let bends = [1.0 - f, 3.0 * f - 2.0, 1.0 - 3.0 * f, f];
        for n in 0..4 {
            out[0][n][l] = s[n];
            out[1][n][l] = bends[n];
        }
    }
    out
}

/// Returns the weights of one point.
#[inline(always)]
pub(crate) fn of_lane(weights: &[Lanes; 4], l: usize) -> [f32; 4] {
    [weights[0][l], weights[1][l], weights[2][l], weights[3][l]]
}

/// Returns the offset of the first of the 4 × 4 × 4 nodes around a point.
#[inline(always)]
pub(crate) fn first_node(lattice: &Lattice<'_>, [a, b, w]: [&Place; 3], l: usize) -> usize {
    let [na, _, nw] = lattice.n_nodes();
    ((b.cell[l] as usize * na + a.cell[l] as usize) * nw + w.cell[l] as usize) * lattice.k
}

/// Returns the offsets of the 16 rows of four nodes around a point from the first of them, `[4 j + i]`.
#[inline(always)]
pub(crate) fn offsets(lattice: &Lattice<'_>) -> [usize; 16] {
    let [na, _, nw] = lattice.n_nodes();
    let (stride_a, stride_b) = (nw * lattice.k, na * nw * lattice.k);
    let mut out = [0; 16];
    for j in 0..4 {
        for i in 0..4 {
            out[4 * j + i] = j * stride_b + i * stride_a;
        }
    }
    out
}

/// The nodes along w of K channels, which lie side by side in memory and are summed as one.
pub(crate) type AlongW<const K: usize> = [[f32; 4]; K];

/// Returns the nodes along w from a place on.
#[inline(always)]
fn row<const K: usize>(nodes: &[f32], at: usize) -> &AlongW<K> {
    // No row begins behind this, which the compiler then knows, too.
    let at = at.min(nodes.len().saturating_sub(4 * K));
    nodes[at..at + 4 * K].as_chunks().0.first_chunk().expect("four nodes")
}

/// Adds `weight` times a row of nodes.
#[inline(always)]
fn add<S: Simd, const K: usize>(sum: &mut AlongW<K>, row: &AlongW<K>, weight: f32) {
    for node in 0..K {
        for c in 0..4 {
            sum[node][c] = mul_add::<S>(weight, row[node][c], sum[node][c]);
        }
    }
}

/// Returns the sum of the nodes around a point over (a, b), with weights `[4 j + i]`. It is taken in four parts, as an
/// addition waits for the one before it.
#[inline(always)]
pub(crate) fn sum_over_ab<S: Simd, const K: usize>(
    nodes: &[f32],
    first: usize,
    offsets: &[usize; 16],
    weights: &[Lanes; 16],
    l: usize,
) -> AlongW<K> {
    let (mut s0, mut s1, mut s2, mut s3) = ([[0.0; 4]; K], [[0.0; 4]; K], [[0.0; 4]; K], [[0.0; 4]; K]);
    for j in 0..4 {
        add::<S, K>(&mut s0, row::<K>(nodes, first + offsets[4 * j]), weights[4 * j][l]);
        add::<S, K>(&mut s1, row::<K>(nodes, first + offsets[4 * j + 1]), weights[4 * j + 1][l]);
        add::<S, K>(&mut s2, row::<K>(nodes, first + offsets[4 * j + 2]), weights[4 * j + 2][l]);
        add::<S, K>(&mut s3, row::<K>(nodes, first + offsets[4 * j + 3]), weights[4 * j + 3][l]);
    }
    add::<S, K>(&mut s0, &s1, 1.0);
    add::<S, K>(&mut s2, &s3, 1.0);
    add::<S, K>(&mut s0, &s2, 1.0);
    s0
}

/// Returns three sums like [`sum_over_ab`], each with its weights.
#[inline(always)]
pub(crate) fn three_sums_over_ab<S: Simd, const K: usize>(
    nodes: &[f32],
    first: usize,
    offsets: &[usize; 16],
    weights: &[[Lanes; 16]; 3],
    l: usize,
) -> [AlongW<K>; 3] {
    let (mut s, mut d, mut e) = ([[0.0; 4]; K], [[0.0; 4]; K], [[0.0; 4]; K]);
    for n in 0..16 {
        let row = row::<K>(nodes, first + offsets[n]);
        add::<S, K>(&mut s, row, weights[0][n][l]);
        add::<S, K>(&mut d, row, weights[1][n][l]);
        add::<S, K>(&mut e, row, weights[2][n][l]);
    }
    [s, d, e]
}

/// Stores the sums of a point, so that they can be read again from every fourth on.
#[inline(always)]
pub(crate) fn store<const K: usize>(sums: &[[f32; 4]; K], to: &mut [f32; SUMS]) {
    to.as_chunks_mut().0[..K].copy_from_slice(sums);
}

/// Returns Σ weights × sums over the four nodes along w, for up to eight channels of which the first K count.
#[inline(always)]
pub(crate) fn sum_over_w<S: Simd, const K: usize>(sums: &[f32; SUMS], weights: [f32; 4]) -> [f32; 8] {
    let mut out = [0.0f32; 8];
    for (node, weight) in weights.into_iter().enumerate() {
        let from: &[f32; 8] = sums[node * K..].first_chunk().expect("room behind the sums");
        for c in 0..8 {
            out[c] = mul_add::<S>(weight, from[c], out[c]);
        }
    }
    out
}
