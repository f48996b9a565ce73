//! The codewords that a field has along camera rays.

use rayon::prelude::*;

use crate::reconstruct::scene::Scene;

/// Depths along a ray at which the field is asked what codewords there may be.
const DEPTHS: usize = 12;

/// What codewords the field has along the rays of `pixels`, at any depth.
pub(super) fn along_rays(scene: &Scene<'_>, pixels: &[usize]) -> Vec<f32> {
    let k = scene.measurements.k;
    let of_pixel = |i: &usize| {
        let (ray, [near, far]) = (scene.rays.in_frame(*i), scene.rays.range[*i]);
        let mut codewords = vec![0.0; if near < far { DEPTHS * k } else { 0 }];
        for (n, c) in codewords.chunks_exact_mut(k).enumerate() {
            let t = near + (far - near) * (n as f32 + 0.5) / DEPTHS as f32;
            scene.grid.eval(ray.at(f64::from(t)).q, c);
        }
        codewords
    };
    pixels.par_iter().flat_map_iter(of_pixel).collect()
}
