//! Checking that the print in the image is the board's.

use super::pixels::Pixels;
use super::warp::Warp;
use crate::board::{Artwork, Marker};

/// Bits looked at along a marker's side: finer than any dictionary's, so that every bit is met.
const SAMPLES: usize = 8;

/// Returns the mean correlation between what is printed inside the markers and the image there: 1 when all bits agree,
/// about 0 for other bits. `None` when no marker lies in the image.
pub(super) fn agreement(image: &Pixels, markers: &[Marker], artwork: &Artwork, warp: &Warp) -> Option<f64> {
    let (mut total, mut n) = (0.0, 0usize);
    // A hundred markers tell as much as a thousand.
    for marker in markers.iter().step_by(markers.len() / 100 + 1) {
        let mut pairs = Vec::with_capacity(SAMPLES * SAMPLES);
        for j in 0..SAMPLES {
            for i in 0..SAMPLES {
                // The border is black in every marker and says nothing: a sixth of a side or less.
                let at = |k: usize| 1.0 / 6.0 + (k as f64 + 0.5) / SAMPLES as f64 * (2.0 / 3.0);
                let (u, v) = (at(i), at(j));
                let c = &marker.corners_mm;
                let b: [f64; 2] = std::array::from_fn(|k| {
                    (1.0 - v) * ((1.0 - u) * c[0][k] + u * c[1][k]) + v * ((1.0 - u) * c[3][k] + u * c[2][k])
                });
                if let Some(value) = image.nearest(warp.px(b)) {
                    pairs.push((f64::from(artwork.albedo(b[0], b[1])), f64::from(value)));
                }
            }
        }
        if pairs.len() == SAMPLES * SAMPLES
            && let Some(r) = correlation(&pairs)
        {
            total += r;
            n += 1;
        }
    }
    (n > 0).then(|| total / n as f64)
}

/// Returns Pearson's correlation; `None` when one side does not vary.
fn correlation(pairs: &[(f64, f64)]) -> Option<f64> {
    let n = pairs.len() as f64;
    let (a, b) = (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
    let (mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0);
    for p in pairs {
        let (x, y) = (p.0 - a, p.1 - b);
        (aa, ab, bb) = (aa + x * x, ab + x * y, bb + y * y);
    }
    let r = ab / (aa * bb).sqrt();
    r.is_finite().then_some(r)
}
