//! The fractions of a pixel's light that did not come directly from the light source: ambient light, interreflection
//! from the surface that the camera sees, and unseen indirect light.
//!
//! A pixel's codeword is `c + a (1 − c) + g (s − c) + b (s̄ − c)`. Ambient light has codeword 1 (white and pattern have
//! it alike) and fraction a. The light gathered from the reconstructed surface has codeword s and fraction g = ρ ·
//! [`Interreflection::per_albedo`]. Indirect light from outside the camera's view has, to first order, the mean
//! codeword s̄ of the surroundings and a fraction b that changes slowly over the image. The albedo ρ is one number per
//! color channel and scene. Ambient light falls on a surface however it faces the light source, so what is smooth is
//! not its fraction but its fraction times white − black.

use nelu3d_field::cost_volume::LightFractionEquations;
use nelu3d_scan::statistics::median;
use rayon::prelude::*;

use super::blocks::Blocks;
use super::interreflection::Interreflection;
use super::window::Window;
use crate::reconstruct::light_fractions::LightFractionPrior;
use crate::sensor::Measurements;

/// Light fractions of one pixel in one color channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PixelFractions {
    /// Fraction of ambient light.
    pub(super) ambient: f32,
    /// Fraction of interreflection, gathered from the surface.
    pub(super) gathered: f32,
    /// Fraction of unseen indirect light.
    pub(super) unseen: f32,
}

impl PixelFractions {
    /// Returns the fraction of all light that is not direct.
    pub(super) fn sum(&self) -> f32 {
        self.ambient + self.gathered + self.unseen
    }
}

/// Light fractions of all pixels of a window, and what stays the same while they are updated.
pub(super) struct LightFractions<'a> {
    m: &'a Measurements,
    window: &'a Window,
    active: &'a [bool],
    channels: usize,
    /// One over the prior variances of ambient and of unseen indirect light.
    prior: [f32; 2],
    /// Radius over which fractions are smooth, px.
    radius: usize,
    /// The squares of pixels in which fractions are estimated.
    blocks: Blocks,
    /// Median of white − black over the window, per channel.
    reference: Vec<f32>,
    /// Fractions, `n × channels`.
    pub(super) of_pixels: Vec<PixelFractions>,
    /// Estimated albedo per channel, as far as interreflection determines it.
    pub(super) albedo: Vec<f32>,
    /// Interreflection gathered from the surface, once there is one.
    pub(super) interreflection: Option<Interreflection>,
}

/// Blocks of pixels across the radius of the small squares: what is smooth needs no more.
const PARTS: usize = 3;
/// Radius of the wide squares over that of the small ones.
const WIDE: usize = 3;
/// Prior standard deviation of fractions over that of their difference between wide and small squares.
const STEADIER: f32 = 5.0;
/// Largest fraction of ambient light. Beyond such limits a codeword tells more about its surroundings than about
/// itself.
const MAX_AMBIENT: f32 = 0.6;
/// Largest fraction of interreflection.
const MAX_GATHERED: f32 = 0.7;
/// Largest fraction of all light that is not direct.
const MAX_TOTAL: f32 = 0.9;

impl<'a> LightFractions<'a> {
    /// Prepares fractions that will be smooth over `radius` pixels; all are 0 yet.
    pub(super) fn new(
        m: &'a Measurements,
        window: &'a Window,
        active: &'a [bool],
        channels: usize,
        prior: &LightFractionPrior,
        radius: usize,
    ) -> Self {
        let reference = (0..channels).map(|c| {
            let on = (0..active.len()).filter(|i| active[*i]);
            let mut light: Vec<f32> = on.map(|i| m.light[window.at(i) * channels + c]).collect();
            median(&mut light).unwrap_or(1.0)
        });
        Self {
            m,
            window,
            active,
            channels,
            prior: prior.weights(m),
            radius,
            blocks: Blocks::new(window.w, window.h, (radius / PARTS).max(1)),
            reference: reference.collect(),
            of_pixels: vec![PixelFractions::default(); active.len() * channels],
            albedo: vec![0.0; channels],
            interreflection: None,
        }
    }

    /// Returns what pixel `i` of the window, pixel `px` of the image, should have measured in channel `j`, where the
    /// color field is `c`.
    #[inline]
    pub(super) fn explain(&self, i: usize, px: usize, j: usize, c: f32) -> f32 {
        let f = self.of_pixels[i * self.channels + j % self.channels];
        let gathered = self.interreflection.as_ref().map_or(0.0, |g| f.gathered * g.codeword[i * self.m.k + j]);
        c * (1.0 - f.sum()) + f.ambient + gathered + f.unseen * self.m.surround[px * self.m.k + j]
    }

    /// Estimates albedo and fractions anew. `rendered` holds c and its slope by the unknown depth, `n × 2 k`.
    pub(super) fn update(&mut self, rendered: &[f32]) {
        if self.interreflection.is_some() {
            self.albedo = (0..self.channels).map(|c| self.estimate_albedo(rendered, c)).collect();
        }
        for c in 0..self.channels {
            self.update_channel(rendered, c);
        }
    }

    /// Returns the weight of a pixel in estimates: a codeword that nothing explains counts little.
    pub(super) fn weight(&self, chi2: f32) -> f32 {
        let robust = 1.0 / (1.0 + chi2 / (30.0 * self.m.independent));
        robust * robust
    }

    /// Returns the albedo that explains the gathered light best, all pixels together. A wrong depth can imitate
    /// indirect light, so what counts is what no change of depth explains, where a pixel has enough patterns to tell
    /// the two apart.
    fn estimate_albedo(&self, rendered: &[f32], channel: usize) -> f32 {
        let (m, k, channels) = (self.m, self.m.k, self.channels);
        let Some(gathered) = &self.interreflection else { return 0.0 };
        let rows: Vec<[f64; 2]> = (0..self.window.h)
            .into_par_iter()
            .map(|y| {
                let mut row = [0.0f64; 2];
                for i in (y * self.window.w..(y + 1) * self.window.w).filter(|i| self.active[*i]) {
                    let px = self.window.at(i);
                    let per_albedo = gathered.per_albedo[i * channels + channel];
                    let f = self.of_pixels[i * channels + channel];
                    // Overlaps of slope d, effect b and residual r: dd, db, dr, bb, br.
                    let (mut q, mut chi2) = ([0.0f32; 5], 0.0);
                    for j in (channel..k).step_by(channels) {
                        let (c, d) = (rendered[i * 2 * k + j], rendered[i * 2 * k + k + j]);
                        let iv = m.inv_var[px * k + j];
                        let known = f.ambient * (1.0 - c) + f.unseen * (m.surround[px * k + j] - c);
                        let r = m.p[px * k + j] - c - known;
                        let b = per_albedo * (gathered.codeword[i * k + j] - c);
                        for (q, v) in q.iter_mut().zip([d * d, d * b, d * r, b * b, b * r]) {
                            *q += iv * v;
                        }
                        chi2 += iv * r * r;
                    }
                    let depth = if k > channels { 1.0 / (q[0] + 1e-9) } else { 0.0 };
                    let weight = self.weight(chi2);
                    row[0] += f64::from(weight * (q[3] - q[1] * q[1] * depth));
                    row[1] += f64::from(weight * (q[4] - q[1] * q[2] * depth));
                }
                row
            })
            .collect();
        let [bb, br] = rows.iter().fold([0.0, 0.0], |s, r| [s[0] + r[0], s[1] + r[1]]);
        // A prior of 0 ± 1 decides where nothing else does.
        ((br / (bb + 1.0)) as f32).clamp(0.0, 1.0)
    }

    /// Estimates the fractions of one channel: normal equations averaged over squares, solved in closed form.
    fn update_channel(&mut self, rendered: &[f32], channel: usize) {
        let (m, k, channels, w) = (self.m, self.m.k, self.channels, self.window.w);
        let mut of_pixels = std::mem::take(&mut self.of_pixels);
        let blocks = &self.blocks;
        let (interreflection, albedo) = (self.interreflection.as_ref(), self.albedo[channel]);
        let ambient_scale =
            |px: usize| (self.reference[channel] / m.light[px * channels + channel].max(1e-6)).clamp(0.1, 10.0);
        let gathered = |i: usize| {
            interreflection.map_or(0.0, |g| (albedo * g.per_albedo[i * channels + channel]).min(MAX_GATHERED))
        };
        let equations_of = |i: usize| {
            let px = self.window.at(i);
            let (g, scale) = (gathered(i), ambient_scale(px));
            let (mut v, mut chi2) = (LightFractionEquations::default(), 0.0);
            for j in (channel..k).step_by(channels) {
                let (c, iv) = (rendered[i * 2 * k + j], m.inv_var[px * k + j]);
                let s = interreflection.map_or(c, |g| g.codeword[i * k + j]);
                let r = m.p[px * k + j] - c - g * (s - c);
                v.add(r, scale * (1.0 - c), m.surround[px * k + j] - c, iv);
                chi2 += iv * r * r;
            }
            let weight = self.weight(chi2);
            v.sums.map(|v| v * weight)
        };
        let terms = blocks.means(|i| if self.active[i] { equations_of(i) } else { [0.0; 5] });
        let [small, wide] = [self.radius, WIDE * self.radius].map(|radius| blocks.smoothed(&terms, radius));
        drop(terms);
        let solved: Vec<[f32; 2]> = (0..blocks.n())
            .into_par_iter()
            .with_min_len(blocks.width)
            .map(|i| solve(small.each_ref().map(|s| s[i]), wide.each_ref().map(|s| s[i]), self.prior))
            .collect();
        of_pixels.par_chunks_mut(w * channels).enumerate().for_each(|(y, row)| {
            for (x, px) in row.chunks_exact_mut(channels).enumerate().filter(|(x, _)| self.active[y * w + x]) {
                let i = y * w + x;
                let [a, unseen] = blocks.at(&solved, [x, y]);
                let ambient = (a * ambient_scale(self.window.at(i))).min(MAX_AMBIENT);
                let gathered = gathered(i).min(MAX_TOTAL - ambient);
                px[channel] = PixelFractions { ambient, gathered, unseen: unseen.min(MAX_TOTAL - ambient - gathered) };
            }
        });
        self.of_pixels = of_pixels;
    }
}

/// Returns the fractions of ambient and of unseen indirect light from the normal equations over a small square and over
/// a wide one around it. `prior` are one over the prior variances of both.
pub fn solve(small: [f32; 5], wide: [f32; 5], prior: [f32; 2]) -> [f32; 2] {
    let (around, _) = LightFractionEquations { sums: wide }.solve(prior);
    let steady = prior.map(|p| STEADIER * STEADIER * p);
    let mut equations = LightFractionEquations { sums: small };
    equations.sums[3] += steady[0] * around[0];
    equations.sums[4] += steady[1] * around[1];
    equations.solve(steady).0
}
