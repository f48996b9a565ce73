//! Pixels at a surface's outline that it covers only in part.
//!
//! What else such a pixel sees is dark, so its codeword is that of the surface's rim, while the ray through its middle
//! may pass the rim by: at the lip of a vase, which it passes by tens of millimeters. Its brightness tells.

use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// Rejects the pixels beside a hole of a depth map (NaN) whose white − black is below `least` of the mean of what is
/// around them and not beside a hole, as [`PixelStatus::DepthDiscontinuity`]; then, once more, those that lay behind
/// them.
pub(super) fn reject_partly_covered(depth: &mut [f32], m: &mut Measurements, least: f32) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rim_that_covers_less_than_half_of_a_pixel_is_no_surface() {
        // Columns 4 to 15 have a depth: 4 and 15 are the outline, of which 4 is bright, and 14 and 15 are dim.
        let (w, h) = (20, 9);
        let mut m = Measurements::for_test(w, h, 1);
        let mut depth: Vec<f32> =
            (0..w * h).map(|i| if (4..16).contains(&(i % w)) { 700.0 } else { f32::NAN }).collect();
        m.contrast = (0..w * h).map(|i| [0.5, 0.2, 0.1][(i % w).saturating_sub(13).min(2)]).collect();
        // A dark texture inside is no outline.
        m.contrast[4 * w + 9] = 0.05;
        reject_partly_covered(&mut depth, &mut m, 0.5);
        let kept: Vec<usize> = (0..w).filter(|x| depth[4 * w + x].is_finite()).collect();
        assert_eq!(kept, (4..14).collect::<Vec<_>>());
        assert_eq!(m.status[4 * w + 15], PixelStatus::DepthDiscontinuity);
        assert_eq!(m.status[4 * w + 9], PixelStatus::Valid);
    }
}
