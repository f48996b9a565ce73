//! Gathering the light that reaches every pixel from the reconstructed surface.

use nelu3d_field::bench::Demand;
use nelu3d_field::gathering::{self, Receiver};
use rayon::prelude::*;

use super::patches::Patches;
use super::surface::GatherSurface;
use crate::sensor::Measurements;

/// Interreflection per pixel of a window.
pub struct Interreflection {
    /// Codeword of the light that arrives from the rest of the scene, `n × k`.
    pub codeword: Vec<f32>,
    /// Fraction of that light in the pixel's white for an albedo of 1, `n × channels`.
    pub per_albedo: Vec<f32>,
}

/// Number of light values per point: white per channel, then the k patterns.
fn n_values(m: &Measurements, channels: usize) -> usize {
    channels + m.k
}

/// Gathers the interreflection of every active pixel; also returns what that asks of the machine. It is smooth: the
/// surface reflects light as at most `max_patches` patches, and light is gathered at every second pixel of every second
/// row and interpolated where the surface is smooth.
pub fn gather(
    s: &GatherSurface<'_>,
    m: &Measurements,
    channels: usize,
    focal_px: f32,
    max_patches: usize,
) -> (Interreflection, Demand) {
    let (w, h, k) = (s.window.w, s.window.h, m.k);
    let count = s.active.iter().filter(|a| **a).count();
    let f = (1..).find(|f| count / (f * f) <= max_patches).expect("some reduction is enough");
    let patches = Patches::new(s, m, channels, focal_px, f);
    let lattice = LightLattice::new(s, &patches, n_values(m, channels));
    let mut codeword = vec![0.0; w * h * k];
    let mut per_albedo = vec![0.0; w * h * channels];
    codeword.par_chunks_mut(k * w).zip(per_albedo.par_chunks_mut(channels * w)).enumerate().for_each_init(
        || RowLight::new(w, lattice.n_values),
        |row, (y, (codeword, per_albedo))| {
            row.fill(s, &patches, &lattice, y, focal_px);
            for x in (0..w).filter(|x| s.active[y * w + x]) {
                let (px, light) = (s.window.at(y * w + x), row.of(x));
                for c in 0..channels {
                    per_albedo[x * channels + c] = light[c] / m.light[px * channels + c].max(1e-6);
                }
                for j in 0..k {
                    let white = light[j % channels];
                    let around = m.surround[px * k + j];
                    codeword[x * k + j] = if white > 0.0 { light[channels + j] / white } else { around };
                }
            }
        },
    );
    let points = (0..w * h).filter(|i| s.active[*i] && (i % w).is_multiple_of(2) && (i / w).is_multiple_of(2)).count();
    let demand = gathering::demand(points, patches.0.len(), lattice.n_values);
    (Interreflection { codeword, per_albedo }, demand)
}

/// Light at the pixels of one row.
struct RowLight {
    n_values: usize,
    /// Light, `[pixel][value]`.
    light: Vec<f32>,
    /// Pixels that the lattice has no light for, and what they gather.
    missing: Vec<usize>,
    receivers: Vec<Receiver>,
    gathered: Vec<f32>,
}

impl RowLight {
    fn new(width: usize, n_values: usize) -> Self {
        let light = vec![0.0; width * n_values];
        Self { n_values, light, missing: Vec::new(), receivers: Vec::new(), gathered: Vec::new() }
    }

    /// Fills in the light of the active pixels of row `y`: from the lattice where it has any, else from the patches.
    fn fill(&mut self, s: &GatherSurface<'_>, patches: &Patches, lattice: &LightLattice, y: usize, focal_px: f32) {
        let (w, n) = (s.window.w, self.n_values);
        self.missing.clear();
        self.receivers.clear();
        for x in (0..w).filter(|x| s.active[y * w + x]) {
            if !lattice.interpolate(s, [x, y], focal_px, &mut self.light[x * n..(x + 1) * n]) {
                self.missing.push(x);
                self.receivers.push(s.receiver(y * w + x));
            }
        }
        self.gathered.resize(self.missing.len() * n, 0.0);
        gathering::gather(&patches.0, &self.receivers, &mut self.gathered);
        for (x, light) in self.missing.iter().zip(self.gathered.chunks_exact(n)) {
            self.light[x * n..(x + 1) * n].copy_from_slice(light);
        }
    }

    /// Returns the light of the pixel at column `x`.
    fn of(&self, x: usize) -> &[f32] {
        &self.light[x * self.n_values..(x + 1) * self.n_values]
    }
}

/// Light at every second pixel of every second row of a window.
struct LightLattice {
    n_values: usize,
    /// Points per row.
    width: usize,
    /// Light, `[point][value]`.
    light: Vec<f32>,
}

impl LightLattice {
    /// Gathers `n_values` light values from the patches at every point on the surface.
    fn new(s: &GatherSurface<'_>, patches: &Patches, n_values: usize) -> Self {
        let (w, h) = (s.window.w, s.window.h);
        let width = w.div_ceil(2);
        let mut light = vec![0.0f32; width * h.div_ceil(2) * n_values];
        light.par_chunks_mut(width * n_values).enumerate().for_each(|(y, row)| {
            let on: Vec<usize> = (0..width).filter(|x| s.active[2 * y * w + 2 * x]).collect();
            let receivers: Vec<Receiver> = on.iter().map(|x| s.receiver(2 * y * w + 2 * x)).collect();
            let mut gathered = vec![0.0; on.len() * n_values];
            gathering::gather(&patches.0, &receivers, &mut gathered);
            for (x, light) in on.into_iter().zip(gathered.chunks_exact(n_values)) {
                row[x * n_values..(x + 1) * n_values].copy_from_slice(light);
            }
        });
        Self { n_values, width, light }
    }

    /// Writes the mean light of the points around pixel (x, y) that lie on the same smooth piece of surface to `out`;
    /// returns whether there are any.
    fn interpolate(&self, s: &GatherSurface<'_>, [x, y]: [usize; 2], focal_px: f32, out: &mut [f32]) -> bool {
        let (w, h) = (s.window.w, s.window.h);
        out.fill(0.0);
        let mut total = 0.0;
        for yy in [y / 2, y.div_ceil(2)] {
            for xx in [x / 2, x.div_ceil(2)] {
                let j = 2 * yy * w + 2 * xx;
                if 2 * yy < h && 2 * xx < w && s.active[j] && s.is_smooth_between(y * w + x, j, focal_px) {
                    total += 1.0;
                    let there = &self.light[(yy * self.width + xx) * self.n_values..][..self.n_values];
                    out.iter_mut().zip(there).for_each(|(s, v)| *s += v);
                }
            }
        }
        if total > 0.0 {
            out.iter_mut().for_each(|s| *s /= total);
        }
        total > 0.0
    }
}
