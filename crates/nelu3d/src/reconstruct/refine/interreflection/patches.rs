//! The reconstructed surface as patches that reflect light.

use super::surface::GatherSurface;
use super::vector::dot;
use crate::sensor::Measurements;

/// Diffuse patches of the surface, which reflect light.
#[derive(Default)]
pub(super) struct Patches {
    /// Camera-frame coordinates, mm.
    x: [Vec<f32>; 3],
    /// Unit normals.
    normal: [Vec<f32>; 3],
    /// Areas, mm².
    area: Vec<f32>,
    /// Mean radiance of white per channel, then of each of the k patterns, patch by patch.
    radiance: Vec<f32>,
}

impl Patches {
    /// Returns the number of patches.
    pub(super) fn len(&self) -> usize {
        self.area.len()
    }

    /// Makes one patch per block of `f × f` pixels, two where the block straddles a depth jump.
    pub(super) fn new(s: &GatherSurface<'_>, m: &Measurements, channels: usize, focal_px: f32, f: usize) -> Self {
        let (w, h) = (s.window.w, s.window.h);
        let mut out = Self::default();
        let mut members = Vec::new();
        for block in 0..w.div_ceil(f) * h.div_ceil(f) {
            let (x0, y0) = (block % w.div_ceil(f) * f, block / w.div_ceil(f) * f);
            members.clear();
            for y in y0..(y0 + f).min(h) {
                members.extend((y * w + x0..y * w + (x0 + f).min(w)).filter(|i| s.active[*i]));
            }
            for _ in 0..2 {
                if members.is_empty() {
                    break;
                }
                let mid = members.len() / 2;
                let (_, middle, _) =
                    members.select_nth_unstable_by(mid, |a, b| s.points[*a][2].total_cmp(&s.points[*b][2]));
                let z = s.points[*middle][2];
                let reach = 4.0 * f as f32 * z / focal_px;
                let near = |i: &usize| (s.points[*i][2] - z).abs() <= reach;
                out.push(s, m, channels, focal_px, members.iter().copied().filter(near));
                members.retain(|i| !near(i));
            }
        }
        out
    }

    /// Adds the patch of some pixels, unless it has no normal.
    fn push(
        &mut self,
        s: &GatherSurface<'_>,
        m: &Measurements,
        channels: usize,
        focal_px: f32,
        pixels: impl Iterator<Item = usize>,
    ) {
        let k = m.k;
        let at = self.radiance.len();
        self.radiance.resize(at + channels + k, 0.0);
        let (mut x, mut normal, mut total) = ([0.0f32; 3], [0.0f32; 3], 0.0f32);
        for i in pixels {
            let (p, n, px) = (s.points[i], s.normals[i], s.window.at(i));
            // The area of an oblique surface in a pixel; a grazing normal is not trusted beyond a factor of ten.
            let cos = (-dot(n, p) / dot(p, p).sqrt()).max(0.1);
            let area = (p[2] / focal_px).powi(2) / cos;
            total += area;
            for c in 0..3 {
                x[c] += area * p[c];
                normal[c] += area * n[c];
            }
            let radiance = &mut self.radiance[at..];
            for c in 0..channels {
                radiance[c] += area * m.light[px * channels + c];
            }
            for j in (0..k).filter(|j| m.inv_var[px * k + j] > 0.0) {
                radiance[channels + j] += area * m.p[px * k + j] * m.light[px * channels + j % channels];
            }
        }
        let len = dot(normal, normal).sqrt();
        if len.is_nan() || len <= 0.0 {
            self.radiance.truncate(at);
            return;
        }
        for c in 0..3 {
            self.x[c].push(x[c] / total);
            self.normal[c].push(normal[c] / len);
        }
        self.radiance[at..].iter_mut().for_each(|v| *v /= total);
        self.area.push(total);
    }

    /// Sums over patches the radiance of each times its form factor from a point, cos θ_x cos θ_y A / (π r² + A): that
    /// of a disc that faces the point, finite however near. `factors` is scratch, one per patch.
    pub(super) fn gather(&self, x: [f32; 3], n: [f32; 3], factors: &mut [f32], out: &mut [f32]) {
        let count = factors.len();
        let [px, py, pz] = [&self.x[0][..count], &self.x[1][..count], &self.x[2][..count]];
        let [nx, ny, nz] = [&self.normal[0][..count], &self.normal[1][..count], &self.normal[2][..count]];
        let area = &self.area[..count];
        for j in 0..count {
            let d = [px[j] - x[0], py[j] - x[1], pz[j] - x[2]];
            let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + 1e-6;
            let here = (d[0] * n[0] + d[1] * n[1] + d[2] * n[2]).max(0.0);
            let there = (d[0] * nx[j] + d[1] * ny[j] + d[2] * nz[j]).min(0.0);
            factors[j] = -here * there * area[j] / (r2 * (std::f32::consts::PI * r2 + area[j]));
        }
        out.fill(0.0);
        for (radiance, f) in self.radiance.chunks_exact(out.len()).zip(&*factors) {
            if *f > 0.0 {
                for (o, s) in out.iter_mut().zip(radiance) {
                    *o += f * s;
                }
            }
        }
    }
}
