//! Plain form, one candidate after the other.

use super::{Codes, Hit, Shape};

/// Returns the closest candidate of every query, `queries[query][channel]`, among the positions `ranges[query]` (from,
/// to), or all.
///
/// # Panics
/// If a length does not fit.
pub fn nearest(shape: Shape, codes: Codes<'_>, queries: &[f32], ranges: Option<&[[u32; 2]]>, hits: &mut [Hit]) {
    codes.check(shape, queries, ranges, hits);
    let Shape { n_channels: k, n_positions, stride } = shape;
    for (n, hit) in hits.iter_mut().enumerate() {
        let query = &queries[n * k..(n + 1) * k];
        *hit = Hit::NONE;
        if query.iter().all(|q| q.is_nan()) {
            continue;
        }
        let [from, to] = ranges.map_or([0, n_positions as u32], |r| r[n]);
        for p in from..to {
            let mut distance = 0.0;
            for (j, q) in query.iter().enumerate().filter(|(_, q)| !q.is_nan()) {
                let c = match codes {
                    Codes::Full { data, row_len } => data[n * row_len + j * stride + p as usize],
                    Codes::LowRank { left, row_len, right, rank } => {
                        let left = &left[n * row_len + j * rank..][..rank];
                        let right = |i: usize| right[(j * rank + i) * stride + p as usize];
                        left.iter().enumerate().fold(0.0, |sum, (i, l)| sum + l * right(i))
                    }
                };
                distance += (c - q) * (c - q);
            }
            if distance < hit.distance {
                *hit = Hit { index: p, distance };
            }
        }
    }
}
