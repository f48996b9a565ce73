//! The shares of light that is not in c: ambient light, light by way of the surface that the camera sees, and the rest of
//! interreflection.
//!
//! A pixel's codeword is `c + a (1 − c) + g (s − c) + b (s̄ − c)`: ambient light has codeword 1 (white and pattern have it
//! alike); the light gathered from the reconstructed surface has codeword s and share g = ρ · [`Interreflection::per_albedo`];
//! what comes from where the camera does not look has, to first order, the mean codeword s̄ of the surroundings and a share b
//! that changes slowly over the image. The albedo ρ is one number per color channel and scene. Ambient light falls on a
//! surface however it faces the light source, so not its share is smooth but its share times white − black.

use nelu3d_field::cost_volume::LightFractionEquations;
use rayon::prelude::*;

use super::interreflection::Interreflection;
use super::window::Window;
use crate::reconstruct::light_fractions::LightFractionPrior;
use crate::sensor::Measurements;
use nelu3d_scan::image::box_mean;

/// LightFractions of one pixel in one color channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Fractions {
    /// Of ambient light.
    pub(super) ambient: f32,
    /// Of light gathered from the surface.
    pub(super) gathered: f32,
    /// Of the rest of interreflection.
    pub(super) rest: f32,
}

impl Fractions {
    /// All of it.
    pub(super) fn sum(&self) -> f32 {
        self.ambient + self.gathered + self.rest
    }
}

/// LightFractions of all pixels of a window, and what stays the same while they are updated.
pub(super) struct LightFractions<'a> {
    m: &'a Measurements,
    window: &'a Window,
    active: &'a [bool],
    channels: usize,
    /// Inverse prior variances of ambient light and the rest.
    prior: [f32; 2],
    radius: usize,
    /// Median of white − black over the window, per channel.
    reference: Vec<f32>,
    /// `n × channels`.
    pub(super) fractions: Vec<Fractions>,
    /// Estimated albedo per channel, as far as interreflection tells it.
    pub(super) albedo: Vec<f32>,
    /// Light gathered from the surface, once there is one.
    pub(super) indirect: Option<Interreflection>,
}

/// A share's upper limits: beyond them a codeword says more about its surroundings than about its own place.
const MAX_AMBIENT: f32 = 0.6;
const MAX_GATHERED: f32 = 0.7;
const MAX_TOTAL: f32 = 0.9;

impl<'a> LightFractions<'a> {
    /// No shares yet; they will be smooth over `radius` pixels.
    pub(super) fn new(
        m: &'a Measurements,
        window: &'a Window,
        active: &'a [bool],
        channels: usize,
        prior: &LightFractionPrior,
        radius: usize,
    ) -> Self {
        let reference = (0..channels)
            .map(|c| {
                let on = (0..active.len()).filter(|i| active[*i]);
                let mut light: Vec<f32> = on.map(|i| m.light[window.at(i) * channels + c]).collect();
                let mid = light.len() / 2;
                if light.is_empty() { 1.0 } else { *light.select_nth_unstable_by(mid, f32::total_cmp).1 }
            })
            .collect();
        Self {
            m,
            window,
            active,
            channels,
            prior: prior.weights(m),
            radius,
            reference,
            fractions: vec![Fractions::default(); active.len() * channels],
            albedo: vec![0.0; channels],
            indirect: None,
        }
    }

    /// What pixel `i` should have measured in `c`'s place `j`.
    #[inline]
    pub(super) fn explain(&self, i: usize, px: usize, j: usize, c: f32) -> f32 {
        let s = self.fractions[i * self.channels + j % self.channels];
        let gathered = self.indirect.as_ref().map_or(0.0, |g| s.gathered * g.codeword[i * self.m.k + j]);
        c * (1.0 - s.sum()) + s.ambient + gathered + s.rest * self.m.surround[px * self.m.k + j]
    }

    /// Estimates albedo and shares anew. `rendered` holds c and its slope by the unknown depth, `n × 2 k`.
    pub(super) fn update(&mut self, rendered: &[f32]) {
        if self.indirect.is_some() {
            self.albedo = (0..self.channels).map(|c| self.estimate_albedo(rendered, c)).collect();
        }
        for c in 0..self.channels {
            self.update_channel(rendered, c);
        }
    }

    /// The pixel's weight as a witness: a codeword that nothing explains is none.
    fn trust(&self, chi2: f32) -> f32 {
        let robust = 1.0 / (1.0 + chi2 / (30.0 * self.m.independent));
        robust * robust
    }

    /// The albedo that explains best, all pixels together, what is gathered. A wrong depth can imitate indirect light, so only
    /// what no change of depth explains counts, where a pixel has enough patterns to tell the two apart.
    fn estimate_albedo(&self, rendered: &[f32], channel: usize) -> f32 {
        let (m, k, channels) = (self.m, self.m.k, self.channels);
        let Some(indirect) = &self.indirect else { return 0.0 };
        let rows: Vec<[f64; 2]> = (0..self.window.h)
            .into_par_iter()
            .map(|y| {
                let mut row = [0.0f64; 2];
                for i in (y * self.window.w..(y + 1) * self.window.w).filter(|i| self.active[*i]) {
                    let px = self.window.at(i);
                    let per_albedo = indirect.per_albedo[i * channels + channel];
                    let share = self.fractions[i * channels + channel];
                    // Overlaps of slope d, effect b and residual r: dd, db, dr, bb, br.
                    let (mut q, mut chi2) = ([0.0f32; 5], 0.0);
                    for j in (channel..k).step_by(channels) {
                        let (c, d) = (rendered[i * 2 * k + j], rendered[i * 2 * k + k + j]);
                        let iv = m.inv_var[px * k + j];
                        let known = share.ambient * (1.0 - c) + share.rest * (m.surround[px * k + j] - c);
                        let r = m.p[px * k + j] - c - known;
                        let b = per_albedo * (indirect.codeword[i * k + j] - c);
                        for (q, v) in q.iter_mut().zip([d * d, d * b, d * r, b * b, b * r]) {
                            *q += iv * v;
                        }
                        chi2 += iv * r * r;
                    }
                    let depth = if k > channels { 1.0 / (q[0] + 1e-9) } else { 0.0 };
                    let trust = self.trust(chi2);
                    row[0] += f64::from(trust * (q[3] - q[1] * q[1] * depth));
                    row[1] += f64::from(trust * (q[4] - q[1] * q[2] * depth));
                }
                row
            })
            .collect();
        let [bb, br] = rows.iter().fold([0.0, 0.0], |s, r| [s[0] + r[0], s[1] + r[1]]);
        // With nothing to go by, none: a prior of 0 ± 1.
        ((br / (bb + 1.0)) as f32).clamp(0.0, 1.0)
    }

    /// Ambient light and the rest of one channel: normal equations averaged over squares, solved in closed form.
    fn update_channel(&mut self, rendered: &[f32], channel: usize) {
        let (m, k, channels, w) = (self.m, self.m.k, self.channels, self.window.w);
        let n = self.active.len();
        let ambient_scale =
            |px: usize| (self.reference[channel] / m.light[px * channels + channel].max(1e-6)).clamp(0.1, 10.0);
        let gathered = |i: usize| {
            let per_albedo = self.indirect.as_ref().map_or(0.0, |g| g.per_albedo[i * channels + channel]);
            (self.albedo[channel] * per_albedo).min(MAX_GATHERED)
        };
        let terms: Vec<[f32; 5]> = (0..n)
            .into_par_iter()
            .with_min_len(w)
            .map(|i| {
                if !self.active[i] {
                    return [0.0; 5];
                }
                let (px, g, scale) = (self.window.at(i), gathered(i), ambient_scale(self.window.at(i)));
                let (mut v, mut chi2) = (LightFractionEquations::default(), 0.0);
                for j in (channel..k).step_by(channels) {
                    let (c, iv) = (rendered[i * 2 * k + j], m.inv_var[px * k + j]);
                    let s = self.indirect.as_ref().map_or(c, |g| g.codeword[i * k + j]);
                    let r = m.p[px * k + j] - c - g * (s - c);
                    v.add(r, scale * (1.0 - c), m.surround[px * k + j] - c, iv);
                    chi2 += iv * r * r;
                }
                let trust = self.trust(chi2);
                v.sums.map(|v| v * trust)
            })
            .collect();
        let sums: Vec<Vec<f32>> = (0..5)
            .into_par_iter()
            .map(|j| {
                let mut sum: Vec<f32> = terms.iter().map(|t| t[j]).collect();
                for _ in 0..2 {
                    box_mean(&mut sum, w, self.window.h, self.radius);
                }
                sum
            })
            .collect();
        drop(terms);
        let new: Vec<Fractions> = (0..n)
            .into_par_iter()
            .with_min_len(w)
            .map(|i| {
                if !self.active[i] {
                    return Fractions::default();
                }
                let v = LightFractionEquations { sums: [0, 1, 2, 3, 4].map(|j| sums[j][i]) };
                let ([a, rest], _) = v.solve(self.prior);
                let ambient = (a * ambient_scale(self.window.at(i))).min(MAX_AMBIENT);
                let gathered = gathered(i).min(MAX_TOTAL - ambient);
                Fractions { ambient, gathered, rest: rest.min(MAX_TOTAL - ambient - gathered) }
            })
            .collect();
        for (i, s) in new.into_iter().enumerate() {
            self.fractions[i * channels + channel] = s;
        }
    }
}
