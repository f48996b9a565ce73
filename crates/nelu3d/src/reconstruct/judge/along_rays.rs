//! The codewords that a field has along camera rays.

use crate::reconstruct::scene::Scene;

/// Depths along a ray at which the field is asked what codewords there may be.
const DEPTHS: usize = 12;

/// What codewords the field has along the rays of `pixels`, at any depth.
pub(super) fn along_rays(scene: &Scene<'_>, pixels: &[usize]) -> Vec<f32> {
    let mut codewords = Vec::new();
    let mut c = vec![0.0; scene.measurements.k];
    for i in pixels {
        let (ray, [near, far]) = (scene.rays.in_frame(*i), scene.rays.range[*i]);
        for n in (0..DEPTHS).filter(|_| near < far) {
            let t = near + (far - near) * (n as f32 + 0.5) / DEPTHS as f32;
            scene.grid.eval(ray.at(f64::from(t)).q, &mut c);
            codewords.extend_from_slice(&c);
        }
    }
    codewords
}
