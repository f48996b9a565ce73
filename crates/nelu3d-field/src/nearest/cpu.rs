//! Fast form: a vector of positions at a time, each lane keeping its own best until the end of the row. Every
//! candidate's sum is taken in the reference's order, so both choose the same one.

use super::{Codes, Hit, Shape};
use crate::prefetch::prefetch;
use pulp::{Arch, Simd, WithSimd};

/// Rows by which memory is asked for ahead.
const AHEAD: usize = 8;
/// Values of a cache line.
const LINE: usize = 16;

/// Finds what [`super::reference::nearest`] finds.
///
/// # Panics
/// If a length does not fit.
pub fn nearest(shape: Shape, codes: Codes<'_>, queries: &[f32], ranges: Option<&[[u32; 2]]>, hits: &mut [Hit]) {
    codes.check(shape, queries, ranges, hits);
    Arch::new().dispatch(Nearest { shape, codes, queries, ranges, hits });
}

struct Nearest<'a> {
    shape: Shape,
    codes: Codes<'a>,
    queries: &'a [f32],
    ranges: Option<&'a [[u32; 2]]>,
    hits: &'a mut [Hit],
}

impl WithSimd for Nearest<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { shape, codes, queries, ranges, hits } = self;
        let Shape { n_channels: k, n_positions, stride } = shape;
        let all = [0, n_positions as u32];
        // The channels that were measured, query after query.
        let mut used: Vec<(usize, f32)> = Vec::with_capacity(k);
        for (n, (hit, query)) in hits.iter_mut().zip(queries.chunks_exact(k)).enumerate() {
            *hit = Hit::NONE;
            let range = ranges.map_or(all, |r| r[n]);
            if range[0] >= range[1] {
                continue;
            }
            if let Codes::Full { data, row_len } = codes {
                let row = &data[n * row_len..][..k * stride];
                if ranges.is_none() {
                    // Rows are read one after the other, but machines do not look beyond a page of memory.
                    for line in (0..row.len()).step_by(LINE) {
                        prefetch(row, AHEAD * row_len + line);
                    }
                }
                if query.iter().all(|q| !q.is_nan()) {
                    // The number of channels, where it is small, is told to the compiler.
                    match k {
                        1 => *hit = few::<S, 1>(simd, row, query, range),
                        2 => *hit = few::<S, 2>(simd, row, query, range),
                        3 => *hit = few::<S, 3>(simd, row, query, range),
                        4 => *hit = few::<S, 4>(simd, row, query, range),
                        _ => {}
                    }
                    if k <= 4 {
                        continue;
                    }
                }
            }
            used.clear();
            used.extend(query.iter().copied().enumerate().filter(|(_, q)| !q.is_nan()));
            if used.is_empty() {
                continue;
            }
            let zero = simd.splat_f32s(0.0);
            *hit = match codes {
                Codes::Full { data, row_len } => {
                    let row = &data[n * row_len..][..k * stride];
                    scan(simd, range, |v| {
                        used.iter().fold(zero, |sum, &(j, q)| {
                            add(simd, sum, vector(simd, &row[j * stride..][..stride], v), simd.splat_f32s(q))
                        })
                    })
                }
                Codes::LowRank { left, row_len, right, rank } => {
                    let left = &left[n * row_len..][..k * rank];
                    scan(simd, range, |v| {
                        used.iter().fold(zero, |sum, &(j, q)| {
                            let terms =
                                left[j * rank..][..rank].iter().zip(right[j * rank * stride..].chunks_exact(stride));
                            let entry = terms.fold(zero, |c, (weight, right)| {
                                let term = simd.mul_f32s(simd.splat_f32s(*weight), vector(simd, right, v));
                                simd.add_f32s(c, term)
                            });
                            add(simd, sum, entry, simd.splat_f32s(q))
                        })
                    })
                }
            };
        }
    }
}

/// Returns the `v`th vector of some positions; the last one may end in zeros.
#[inline(always)]
fn vector<S: Simd>(simd: S, positions: &[f32], v: usize) -> S::f32s {
    let (whole, rest) = S::as_simd_f32s(positions);
    if v < whole.len() { whole[v] } else { simd.partial_load_f32s(rest) }
}

/// Returns a sum and a channel's squared differences. Not fused, as the reference's are not.
#[inline(always)]
fn add<S: Simd>(simd: S, sum: S::f32s, codes: S::f32s, query: S::f32s) -> S::f32s {
    let d = simd.sub_f32s(codes, query);
    simd.add_f32s(sum, simd.mul_f32s(d, d))
}

/// Returns the closest of the positions of a row of `K` channels that were all measured.
#[inline(always)]
fn few<S: Simd, const K: usize>(simd: S, row: &[f32], query: &[f32], range: [u32; 2]) -> Hit {
    let stride = row.len() / K;
    let channels: [&[f32]; K] = std::array::from_fn(|j| &row[j * stride..][..stride]);
    let query: [S::f32s; K] = std::array::from_fn(|j| simd.splat_f32s(query[j]));
    scan(simd, range, |v| {
        let mut sum = simd.splat_f32s(0.0);
        for j in 0..K {
            sum = add(simd, sum, vector(simd, channels[j], v), query[j]);
        }
        sum
    })
}

/// The most lanes that a machine has.
const MAX_LANES: usize = 64;
/// Numbers of the lanes.
const LANE: [f32; MAX_LANES] = {
    let mut lane = [0.0; MAX_LANES];
    let mut l = 0;
    while l < MAX_LANES {
        lane[l] = l as f32;
        l += 1;
    }
    lane
};

/// Returns the closest of the positions `from..to`, whose distances `distances(v)` gives for the `v`th vector of
/// positions.
#[inline(always)]
fn scan<S: Simd>(simd: S, [from, to]: [u32; 2], distances: impl Fn(usize) -> S::f32s) -> Hit {
    let lanes = S::F32_LANES;
    let (first, end) = (from as usize / lanes, (to as usize).div_ceil(lanes));
    let infinity = simd.splat_f32s(f32::INFINITY);
    // Per lane its best distance, and where it was found: a float, so that both are chosen by one comparison of whole
    // vectors. Exact, as tables have far fewer than 2^24 positions.
    let (mut best, mut at) = (infinity, infinity);
    let mut here = simd.add_f32s(S::as_simd_f32s(&LANE).0[0], simd.splat_f32s((first * lanes) as u32 as f32));
    for v in first..end {
        let mut sum = distances(v);
        if v == first || v + 1 == end {
            let after = simd.greater_than_or_equal_f32s(here, simd.splat_f32s(from as f32));
            let before = simd.less_than_f32s(here, simd.splat_f32s(to as f32));
            sum = simd.select_f32s(simd.and_m32s(after, before), sum, infinity);
        }
        // False for NaN, too.
        let better = simd.less_than_f32s(sum, best);
        best = simd.select_f32s(better, sum, best);
        at = simd.select_f32s(better, here, at);
        here = simd.add_f32s(here, simd.splat_f32s(lanes as f32));
    }
    // Of equal ones the first.
    let distance = simd.reduce_min_f32s(best);
    let equal = simd.equal_f32s(best, simd.splat_f32s(distance));
    let index = simd.reduce_min_f32s(simd.select_f32s(equal, at, infinity));
    if distance < f32::INFINITY { Hit { index: index as u32, distance } } else { Hit::NONE }
}
