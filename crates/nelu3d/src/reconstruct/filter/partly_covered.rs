//! Pixels at a surface's outline that it covers only in part.
//!
//! What else such a pixel sees is dark, so its codeword is that of the surface's rim, while the ray through its middle
//! may pass the rim by: at the lip of a vase, which it passes by tens of millimeters. Its brightness tells.

use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// Rejects the pixels beside a hole of a depth map (NaN) whose white − black is below `least` of the mean of what is
/// around them and not beside a hole, as [`PixelStatus::DepthDiscontinuity`]; then, once more, those that lay behind
/// them.
pub fn reject_partly_covered(depth: &mut [f32], m: &mut Measurements, least: f32) {
    let (w, h) = (m.width, m.height);
    let around = |i: usize, r: usize| {
        let (x, y) = (i % w, i / w);
        let rows = y.saturating_sub(r)..=(y + r).min(h - 1);
        rows.flat_map(move |y| (x.saturating_sub(r)..=(x + r).min(w - 1)).map(move |x| y * w + x))
    };
    let mut rejected = Vec::new();
    for round in 0..2 {
        let holes = |depth: &[f32], i: usize| around(i, 1).any(|j| depth[j].is_nan());
        let candidates: Vec<usize> =
            if round == 0 { (0..m.n()).collect() } else { rejected.iter().flat_map(|i| around(*i, 1)).collect() };
        let found: Vec<usize> = candidates
            .into_iter()
            .filter(|i| depth[*i].is_finite() && holes(depth, *i))
            .filter(|i| {
                let inside = around(*i, 2).filter(|j| depth[*j].is_finite() && !holes(depth, *j));
                let (n, sum) = inside.fold((0, 0.0), |(n, sum), j| (n + 1, sum + m.contrast[j]));
                n > 0 && m.contrast[*i] < least * sum / n as f32
            })
            .collect();
        for i in &found {
            (depth[*i], m.status[*i]) = (f32::NAN, PixelStatus::DepthDiscontinuity);
        }
        rejected = found;
    }
}
