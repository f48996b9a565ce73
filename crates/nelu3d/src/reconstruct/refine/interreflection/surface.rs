//! The reconstructed surface as points and normals.

use nelu3d_field::gathering::Receiver;
use rayon::prelude::*;

use super::vector::dot;
use crate::color_field::CameraRays;
use crate::reconstruct::refine::window::Window;

/// The surface of a window's active pixels, from which light is gathered.
pub struct GatherSurface<'a> {
    /// The window.
    pub(in crate::reconstruct::refine) window: &'a Window,
    /// Pixels that are part of the surface.
    pub(in crate::reconstruct::refine) active: &'a [bool],
    /// The camera's rays, by the image's pixels.
    rays: &'a CameraRays,
    /// Camera z, mm.
    pub(in crate::reconstruct::refine) z: Vec<f32>,
    /// Unit normals that face the camera.
    pub(in crate::reconstruct::refine) normals: Vec<[f32; 3]>,
}

impl<'a> GatherSurface<'a> {
    /// Makes depths and normals from inverse depths (1/mm) and their slopes (1/mm per pixel along x and y). A plane is
    /// linear in 1/z over the image: 1/z = α + β x/z + γ y/z means that (β, γ, α) is normal to it.
    pub fn new(
        window: &'a Window,
        active: &'a [bool],
        rays: &'a CameraRays,
        inv_z: impl Fn(usize) -> f32 + Sync,
        slope: impl Fn(usize) -> [f32; 2] + Sync,
    ) -> Self {
        let w = window.w;
        let (z, normals) = (0..active.len())
            .into_par_iter()
            .map(|i| {
                if !active[i] {
                    return (0.0, [0.0; 3]);
                }
                let ([u, v], inv_z) = (rays.plane[window.at(i)], inv_z(i));
                // Slopes of single pixels are noisy: the mean over 3 × 3.
                let (mut sum, mut count) = ([0.0f32; 2], 0.0);
                for j in [i - w, i, i + w].into_iter().flat_map(|j| [j - 1, j, j + 1]).filter(|j| active[*j]) {
                    let slope = slope(j);
                    sum = [sum[0] + slope[0], sum[1] + slope[1]];
                    count += 1.0;
                }
                let [beta, gamma] = sum.map(|s| s / count * rays.focal_px);
                let n = [-beta, -gamma, beta * u + gamma * v - inv_z];
                let len = dot(n, n).sqrt();
                (1.0 / inv_z, n.map(|v| v / len))
            })
            .unzip();
        Self { window, active, rays, z, normals }
    }

    /// Returns the point of pixel `i` of the window, camera frame, mm.
    #[inline]
    pub fn point(&self, i: usize) -> [f32; 3] {
        let ([u, v], z) = (self.rays.plane[self.window.at(i)], self.z[i]);
        [u * z, v * z, z]
    }

    /// Returns pixel `i` as a receiver of light.
    pub(super) fn receiver(&self, i: usize) -> Receiver {
        Receiver { point: self.point(i), normal: self.normals[i] }
    }

    /// Returns whether pixels `i` and `j`, close to each other, lie on one smooth piece of surface.
    pub(super) fn is_smooth_between(&self, i: usize, j: usize, focal_px: f32) -> bool {
        let (p, q) = (self.point(i), self.point(j));
        let off = dot(self.normals[i], [q[0] - p[0], q[1] - p[1], q[2] - p[2]]).abs();
        off <= p[2] / focal_px && dot(self.normals[i], self.normals[j]) > 0.9
    }
}
