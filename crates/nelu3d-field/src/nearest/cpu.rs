//! Fast form: [`LANES`] positions at a time, each lane keeping its own best until the end of the row. Every candidate's sum
//! is taken in the reference's order, so both choose the same one.

use super::{Codes, Hit, LANES, Shape};
use pulp::{Arch, Simd, WithSimd};

/// As [`super::reference::nearest`].
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
    fn with_simd<S: Simd>(self, _: S) {
        let Self { shape, codes, queries, ranges, hits } = self;
        let Shape { n_channels: k, n_positions, stride } = shape;
        let all = [0, n_positions as u32];
        // The channels that were measured, query after query.
        let mut used: Vec<(usize, f32)> = Vec::with_capacity(k);
        for (n, (hit, query)) in hits.iter_mut().zip(queries.chunks_exact(k)).enumerate() {
            used.clear();
            used.extend(query.iter().copied().enumerate().filter(|(_, q)| !q.is_nan()));
            *hit = Hit::NONE;
            let range = ranges.map_or(all, |r| r[n]);
            if used.is_empty() || range[0] >= range[1] {
                continue;
            }
            *hit = match codes {
                Codes::Full { data, row_len } => {
                    let row = &data[n * row_len..][..k * stride];
                    scan(range, |first| {
                        let mut sum = [0.0; LANES];
                        for &(j, q) in &used {
                            let c = lanes(row, j * stride + first);
                            for l in 0..LANES {
                                let d = c[l] - q;
                                sum[l] += d * d;
                            }
                        }
                        sum
                    })
                }
                Codes::LowRank { left, row_len, right, rank } => {
                    let left = &left[n * row_len..][..k * rank];
                    scan(range, |first| {
                        let mut sum = [0.0; LANES];
                        for &(j, q) in &used {
                            let mut c = [0.0; LANES];
                            for (i, weight) in left[j * rank..][..rank].iter().enumerate() {
                                let r = lanes(right, (j * rank + i) * stride + first);
                                for l in 0..LANES {
                                    c[l] += weight * r[l];
                                }
                            }
                            for l in 0..LANES {
                                let d = c[l] - q;
                                sum[l] += d * d;
                            }
                        }
                        sum
                    })
                }
            };
        }
    }
}

#[inline(always)]
fn lanes(values: &[f32], from: usize) -> &[f32; LANES] {
    values[from..].first_chunk().expect("strides are whole vectors")
}

/// The closest of the positions `from..to`, whose distances `distances(p)` gives from p on, p a multiple of [`LANES`].
#[inline(always)]
fn scan([from, to]: [u32; 2], distances: impl Fn(usize) -> [f32; LANES]) -> Hit {
    // Per lane its best distance, and the first position of the vector that it was found in: a float, so that both are
    // chosen by one comparison of whole vectors. Exact, as tables have far fewer than 2^24 positions.
    let (mut best, mut found) = ([f32::INFINITY; LANES], [f32::NAN; LANES]);
    let mut first = from / LANES as u32 * LANES as u32;
    while first < to {
        let mut sum = distances(first as usize);
        if first < from || first + LANES as u32 > to {
            for l in 0..LANES {
                let p = first + l as u32;
                sum[l] = if (from..to).contains(&p) { sum[l] } else { f32::INFINITY };
            }
        }
        for l in 0..LANES {
            // False for NaN, too.
            let better = sum[l] < best[l];
            best[l] = if better { sum[l] } else { best[l] };
            found[l] = if better { first as f32 } else { found[l] };
        }
        first += LANES as u32;
    }
    let mut hit = Hit::NONE;
    for (l, (&distance, &first)) in best.iter().zip(&found).enumerate() {
        let index = first as u32 + l as u32;
        if distance < hit.distance || (distance == hit.distance && distance.is_finite() && index < hit.index) {
            hit = Hit { index, distance };
        }
    }
    hit
}
