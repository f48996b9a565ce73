//! The reconstructed surface as points and normals.

use nelu3d_field::gathering::Receiver;
use rayon::prelude::*;

use super::vector::dot;
use crate::color_field::CameraRays;
use crate::reconstruct::refine::window::Window;

/// The surface of a window's active pixels, from which light is gathered.
pub(in crate::reconstruct::refine) struct GatherSurface<'a> {
    /// The window.
    pub(in crate::reconstruct::refine) window: &'a Window,
    /// Pixels that are part of the surface.
    pub(in crate::reconstruct::refine) active: &'a [bool],
    /// Camera-frame points, mm.
    pub(in crate::reconstruct::refine) points: Vec<[f32; 3]>,
    /// Unit normals that face the camera.
    pub(in crate::reconstruct::refine) normals: Vec<[f32; 3]>,
}

impl<'a> GatherSurface<'a> {
    /// Makes points and normals from inverse depths (1/mm) and their slopes (1/mm per pixel along x and y). A plane is
    /// linear in 1/z over the image: 1/z = α + β x/z + γ y/z means that (β, γ, α) is normal to it.
    pub(in crate::reconstruct::refine) fn new(
        window: &'a Window,
        active: &'a [bool],
        rays: &CameraRays,
        inv_z: impl Fn(usize) -> f32 + Sync,
        slopes: &[[f32; 2]],
    ) -> Self {
        let w = window.w;
        let (points, normals) = (0..active.len())
            .into_par_iter()
            .map(|i| {
                if !active[i] {
                    return ([0.0; 3], [0.0; 3]);
                }
                let ([u, v], inv_z) = (rays.plane[window.at(i)], inv_z(i));
                // Slopes of single pixels are noisy: the mean over 3 × 3.
                let (mut sum, mut count) = ([0.0f32; 2], 0.0);
                for j in [i - w, i, i + w].into_iter().flat_map(|j| [j - 1, j, j + 1]).filter(|j| active[*j]) {
                    sum = [sum[0] + slopes[j][0], sum[1] + slopes[j][1]];
                    count += 1.0;
                }
                let [beta, gamma] = sum.map(|s| s / count * rays.focal_px);
                let n = [-beta, -gamma, beta * u + gamma * v - inv_z];
                let len = dot(n, n).sqrt();
                ([u / inv_z, v / inv_z, 1.0 / inv_z], n.map(|v| v / len))
            })
            .unzip();
        Self { window, active, points, normals }
    }

    /// Returns pixel `i` as a receiver of light.
    pub(super) fn receiver(&self, i: usize) -> Receiver {
        Receiver { point: self.points[i], normal: self.normals[i] }
    }

    /// Returns whether pixels `i` and `j`, close to each other, lie on one smooth piece of surface.
    pub(super) fn is_smooth_between(&self, i: usize, j: usize, focal_px: f32) -> bool {
        let (p, q) = (self.points[i], self.points[j]);
        let off = dot(self.normals[i], [q[0] - p[0], q[1] - p[1], q[2] - p[2]]).abs();
        off <= p[2] / focal_px && dot(self.normals[i], self.normals[j]) > 0.9
    }
}
