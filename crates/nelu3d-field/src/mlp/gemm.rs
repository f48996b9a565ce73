//! The two matrix products a network needs, on blocks that fit the first-level cache.
//!
//! Both keep a tile of up to 12 vector accumulators in registers (AVX2 has 16), which covers the latency of two fused
//! multiply-adds per cycle. Rows of points are contiguous in their features, so every operand is read in order and the
//! weight gradient needs no horizontal sums.

use pulp::Simd;

/// Columns of every matrix are padded to a multiple of this many values: the widest vector any dispatched form uses.
pub(super) const LANES: usize = 8;
/// Rows (points) of a block are padded to a multiple of this: the tallest tile.
pub(super) const ROWS: usize = 12;

/// Computes c\[r\]\[j\] = init\[j\] + Σ_k a\[r\]\[k\] b\[k\]\[j\], then max(·, 0) if `relu`.
///
/// `a`: rows × `lda`, of which the first `depth` columns count. `b`: depth × n. `c`: rows × n. `n` is a multiple of
/// [`LANES`], the number of rows one of [`ROWS`].
#[inline(always)]
#[expect(clippy::too_many_arguments)]
pub(super) fn multiply<S: Simd>(
    simd: S,
    a: &[f32],
    lda: usize,
    depth: usize,
    b: &[f32],
    n: usize,
    init: Option<&[f32]>,
    relu: bool,
    c: &mut [f32],
) {
    const { assert!(LANES.is_multiple_of(S::F32_LANES)) };
    assert!(depth <= lda && n.is_multiple_of(LANES) && c.len().is_multiple_of(ROWS * n));
    let nv = n / S::F32_LANES;
    let b = S::as_simd_f32s(&b[..depth * n]).0;
    let init = init.map(|init| S::as_simd_f32s(&init[..n]).0);
    for (a, c) in a.chunks_exact(ROWS * lda).zip(c.chunks_exact_mut(ROWS * n)) {
        let c = S::as_mut_simd_f32s(c).0;
        let mut j = 0;
        while j + 2 <= nv {
            for half in 0..2 {
                let (a, c) = (&a[half * 6 * lda..], &mut c[half * 6 * nv..]);
                multiply_tile::<S, 6, 2>(simd, a, lda, depth, b, nv, j, init, relu, c);
            }
            j += 2;
        }
        if j < nv {
            multiply_tile::<S, 12, 1>(simd, a, lda, depth, b, nv, j, init, relu, c);
        }
    }
}

#[inline(always)]
#[expect(clippy::too_many_arguments)]
fn multiply_tile<S: Simd, const M: usize, const N: usize>(
    simd: S,
    a: &[f32],
    lda: usize,
    depth: usize,
    b: &[S::f32s],
    nv: usize,
    j: usize,
    init: Option<&[S::f32s]>,
    relu: bool,
    c: &mut [S::f32s],
) {
    let zero = simd.splat_f32s(0.0);
    let mut sum = [[zero; N]; M];
    if let Some(init) = init {
        for row in &mut sum {
            row.copy_from_slice(&init[j..j + N]);
        }
    }
    let mut rows: [&[f32]; M] = [&[]; M];
    for (r, row) in rows.iter_mut().enumerate() {
        *row = &a[r * lda..][..depth];
    }
    for (k, b) in b.chunks_exact(nv).enumerate().take(depth) {
        let b = &b[j..j + N];
        for r in 0..M {
            let x = simd.splat_f32s(rows[r][k]);
            for v in 0..N {
                sum[r][v] = simd.mul_add_e_f32s(x, b[v], sum[r][v]);
            }
        }
    }
    for (row, c) in sum.iter().zip(c.chunks_exact_mut(nv)) {
        for (&x, c) in row.iter().zip(&mut c[j..j + N]) {
            *c = if relu { simd.max_f32s(x, zero) } else { x };
        }
    }
}

/// Computes c\[i\]\[j\] += Σ_r a\[r\]\[i\] b\[r\]\[j\] for the first `m` columns of `a`: the gradient of a weight
/// matrix from the gradients of a layer's sums (`a`, rows × `lda`) and its inputs (`b`, rows × n).
#[inline(always)]
pub(super) fn accumulate_outer<S: Simd>(simd: S, a: &[f32], lda: usize, m: usize, b: &[f32], n: usize, c: &mut [f32]) {
    assert!(m <= lda && n.is_multiple_of(LANES) && a.len() / lda == b.len() / n);
    let nv = n / S::F32_LANES;
    let b = S::as_simd_f32s(b).0;
    let c = S::as_mut_simd_f32s(&mut c[..m * n]).0;
    let mut i = 0;
    while i < m {
        let height = match m - i {
            6.. => 6,
            4 | 5 => 4,
            rest => rest,
        };
        let mut j = 0;
        while j < nv {
            let width = if j + 2 <= nv { 2 } else { 1 };
            let c = &mut c[i * nv..];
            match (height, width) {
                (6, 2) => outer_tile::<S, 6, 2>(simd, a, lda, i, b, nv, j, c),
                (6, _) => outer_tile::<S, 6, 1>(simd, a, lda, i, b, nv, j, c),
                (4, 2) => outer_tile::<S, 4, 2>(simd, a, lda, i, b, nv, j, c),
                (4, _) => outer_tile::<S, 4, 1>(simd, a, lda, i, b, nv, j, c),
                (3, 2) => outer_tile::<S, 3, 2>(simd, a, lda, i, b, nv, j, c),
                (3, _) => outer_tile::<S, 3, 1>(simd, a, lda, i, b, nv, j, c),
                (2, 2) => outer_tile::<S, 2, 2>(simd, a, lda, i, b, nv, j, c),
                (2, _) => outer_tile::<S, 2, 1>(simd, a, lda, i, b, nv, j, c),
                (_, 2) => outer_tile::<S, 1, 2>(simd, a, lda, i, b, nv, j, c),
                (_, _) => outer_tile::<S, 1, 1>(simd, a, lda, i, b, nv, j, c),
            }
            j += width;
        }
        i += height;
    }
}

#[inline(always)]
#[expect(clippy::too_many_arguments)]
fn outer_tile<S: Simd, const M: usize, const N: usize>(
    simd: S,
    a: &[f32],
    lda: usize,
    i: usize,
    b: &[S::f32s],
    nv: usize,
    j: usize,
    c: &mut [S::f32s],
) {
    let mut sum = [[simd.splat_f32s(0.0); N]; M];
    for (a, b) in a.chunks_exact(lda).zip(b.chunks_exact(nv)) {
        let (a, b) = (&a[i..i + M], &b[j..j + N]);
        for r in 0..M {
            let x = simd.splat_f32s(a[r]);
            for v in 0..N {
                sum[r][v] = simd.mul_add_e_f32s(x, b[v], sum[r][v]);
            }
        }
    }
    for (row, c) in sum.iter().zip(c.chunks_exact_mut(nv)) {
        for (&x, c) in row.iter().zip(&mut c[j..j + N]) {
            *c = simd.add_f32s(*c, x);
        }
    }
}
