//! Slopes of an inverse depth map.

use rayon::prelude::*;

use super::thin_plate::ThinPlatePrior;

/// Returns the slopes of `x` along the image's x and y, per pixel of the prior's window: central differences, one-sided
/// where the other side lies across a jump (a step of more than `max_step`).
pub(super) fn slopes(prior: &ThinPlatePrior, x: &[f32], max_step: f32) -> Vec<[f32; 2]> {
    (0..x.len())
        .into_par_iter()
        .with_min_len(prior.width)
        .map(|i| {
            if !prior.active[i] {
                return [0.0; 2];
            }
            [1, prior.width].map(|stride| {
                let step = |a: usize, b: usize| (prior.active[a] && prior.active[b]).then(|| x[b] - x[a]);
                match (step(i - stride, i), step(i, i + stride)) {
                    (Some(l), Some(r)) if l.abs().max(r.abs()) <= max_step => 0.5 * (l + r),
                    (Some(l), Some(r)) => {
                        if l.abs() < r.abs() {
                            l
                        } else {
                            r
                        }
                    }
                    (one, None) | (None, one) => one.unwrap_or(0.0),
                }
            })
        })
        .collect()
}

/// Returns cos θ between surface normal and ray, at least 0.2, from the slopes of the surface's 1/z in units of `unit`
/// (1/mm) per pixel.
#[inline]
pub(super) fn cosine([du, dv]: [f32; 2], unit: f32, inv_z: f32, focal_px: f32) -> f32 {
    // dz = −z² d(1/z) over a lateral step of z / focal length.
    let tilt = (du * du + dv * dv).sqrt() * unit / inv_z * focal_px;
    (1.0 / (1.0 + tilt * tilt).sqrt()).max(0.2)
}
