//! The reconstructed surface as patches that reflect light.

use nelu3d_field::gathering;

use super::surface::GatherSurface;
use super::vector::dot;
use crate::sensor::Measurements;

/// Diffuse patches of the surface, which reflect light: white per channel, then each of the k patterns.
pub(super) struct Patches(pub(super) gathering::Patches);

impl Patches {
    /// Makes one patch per block of `f × f` pixels, two where the block straddles a depth jump.
    pub(super) fn new(s: &GatherSurface<'_>, m: &Measurements, channels: usize, focal_px: f32, f: usize) -> Self {
        let (w, h) = (s.window.w, s.window.h);
        let sent = vec![Vec::new(); channels + m.k];
        let mut out = Self(gathering::Patches { sent, ..Default::default() });
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
                let (_, middle, _) = members.select_nth_unstable_by(mid, |a, b| s.z[*a].total_cmp(&s.z[*b]));
                let z = s.z[*middle];
                let reach = 4.0 * f as f32 * z / focal_px;
                let near = |i: &usize| (s.z[*i] - z).abs() <= reach;
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
        let mut radiance = vec![0.0f32; channels + k];
        let (mut x, mut normal, mut total) = ([0.0f32; 3], [0.0f32; 3], 0.0f32);
        for i in pixels {
            let (p, n, px) = (s.point(i), s.normals[i], s.window.at(i));
            // The area of an oblique surface in a pixel; a grazing normal is not trusted beyond a factor of ten.
            let cos = (-dot(n, p) / dot(p, p).sqrt()).max(0.1);
            let area = (p[2] / focal_px).powi(2) / cos;
            total += area;
            for c in 0..3 {
                x[c] += area * p[c];
                normal[c] += area * n[c];
            }
            for c in 0..channels {
                radiance[c] += area * m.light[px * channels + c];
            }
            for j in (0..k).filter(|j| m.inv_var[px * k + j] > 0.0) {
                radiance[channels + j] += area * m.p[px * k + j] * m.light[px * channels + j % channels];
            }
        }
        let len = dot(normal, normal).sqrt();
        if len.is_nan() || len <= 0.0 {
            return;
        }
        let patches = &mut self.0;
        for c in 0..3 {
            patches.center[c].push(x[c] / total);
            patches.normal[c].push(normal[c] / len);
        }
        patches.area.push(total);
        patches.sent.iter_mut().zip(radiance).for_each(|(sent, r)| sent.push(r / total));
    }
}
