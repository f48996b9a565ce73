//! Variances that noise and prior leave in the solution of the linear system.

use nelu3d_scan::image::box_mean;
use rayon::prelude::*;

use super::information::Information;
use super::masked_mean::masked_mean;
use super::uniform_plate::{FrequencyMeans, square};
use super::zones::Zones;
use crate::reconstruct::refine::thin_plate::ThinPlatePrior;

/// Radius over which a pixel's weight is averaged, px.
const LOCAL_RADIUS: usize = 1;
/// Radii over which information is averaged, px: over as many pixels as the solution averages, in between by the
/// logarithm. With the square of that area, variances are those of solutions for random noise on real systems to 2 %
/// on average (6 % with much averaging), be the pixel one of much information or of little; with the nearest neighbors
/// alone, where there is little, 20 to 30 % too large.
const RADII: [usize; 4] = [1, 2, 4, 8];
/// Rounds in which the area that a solution averages over and the information in it are found together.
const ROUNDS: usize = 2;
/// Radius within which edges of the surface matter, px.
const EDGE_RADIUS: usize = 3;
/// Relative excess of the variance at a straight edge: solutions of real systems have 1.9 to 2.5 times as much there.
const EDGE: f32 = 1.3;
/// Radius over which the surface's roughness is compared with the prior's, px.
const ROUGHNESS_RADIUS: usize = 12;

/// Variances that noise and prior leave in the solution, and their energies under the prior, per pixel.
pub struct Posterior {
    /// Variance from noise.
    pub noise: Vec<f32>,
    /// Variance from what the prior smooths away of a surface that is as rough as the prior allows.
    pub prior: Vec<f32>,
    /// Number of pixels that the solution averages over.
    pub pixels: Vec<f32>,
    /// Where roughness is compared with the prior's.
    zones: Zones,
    /// Variance from noise of what is found to be smoothed away.
    pub smoothed_away: Vec<f32>,
    /// Energies in the solution, of noise and of a surface that is as rough as the prior allows.
    whole: Energies,
    /// Energies in the solution of second differences less their mean over [`square()`], of noise and of such a surface.
    rest: Energies,
}

/// Energies under the prior, per pixel.
struct Energies {
    noise: Vec<f32>,
    surface: Vec<f32>,
}

impl Posterior {
    /// Takes the variances and energies of a uniform plate around every pixel.
    pub fn new(prior: &ThinPlatePrior, information: &[Information]) -> Self {
        let (w, h, n) = (prior.width, prior.height, information.len());
        let data: Vec<f32> = information.iter().map(|i| i.h).collect();
        let information = RADII.map(|radius| masked_mean(&data, &prior.active, w, h, radius));
        let far = &information[RADII.len() - 1];
        // The mean of logarithms: where the prior is broken between two pixels, it is neither whole nor missing.
        let weights: Vec<f32> = (0..n).map(|i| prior.weight(i)).collect();
        let has_prior: Vec<bool> = weights.iter().map(|w| *w > 0.0).collect();
        let logs: Vec<f32> = weights.iter().map(|w| if *w > 0.0 { w.ln() } else { 0.0 }).collect();
        let weight = masked_mean(&logs, &has_prior, w, h, LOCAL_RADIUS);
        let mut support: Vec<f32> = prior.active.iter().map(|a| if *a { 1.0 } else { 0.0 }).collect();
        let mut has_weight: Vec<f32> = has_prior.iter().map(|t| if *t { 1.0 } else { 0.0 }).collect();
        box_mean(&mut support, w, h, EDGE_RADIUS);
        box_mean(&mut has_weight, w, h, LOCAL_RADIUS);
        let zero = || vec![0.0f32; n];
        let energies = || Energies { noise: zero(), surface: zero() };
        let mut out = Self {
            noise: zero(),
            prior: zero(),
            pixels: zero(),
            zones: Zones::new(&prior.active, [w, h], ROUGHNESS_RADIUS),
            smoothed_away: zero(),
            whole: energies(),
            rest: energies(),
        };
        let of_pixel = |i: usize| -> (FrequencyMeans, f32) {
            if !prior.active[i] {
                return Default::default();
            }
            let weight = if has_weight[i] > 1e-6 { weight[i].exp() } else { 0.0 };
            // A pixel that measures nothing has a hundredth of the information around it.
            let information_of =
                |pixels: f32| over(pixels, |level| information[level][i]).max(0.01 * far[i]).max(1e-12);
            let mut h = information_of(1.0);
            for _ in 0..ROUNDS {
                h = information_of(1.0 / FrequencyMeans::noise_at(weight / h).max(1e-6));
            }
            (FrequencyMeans::at(weight / h), h)
        };
        let of_pixels: Vec<(FrequencyMeans, f32)> = (0..n).into_par_iter().with_min_len(w).map(of_pixel).collect();
        for (i, (means, h)) in of_pixels.into_iter().enumerate().filter(|(i, _)| prior.active[*i]) {
            let edge = 1.0 + EDGE * (2.0 * (1.0 - support[i]).max(0.0)).sqrt();
            out.noise[i] = edge * means.noise / h;
            out.prior[i] = edge * means.prior / h;
            out.pixels[i] = 1.0 / means.noise.max(1e-6);
            out.smoothed_away[i] = edge * means.smoothed_away / h;
            (out.whole.noise[i], out.whole.surface[i]) = (means.prior, means.noise);
            (out.rest.noise[i], out.rest.surface[i]) = (means.noise_energy, means.surface_energy);
        }
        out
    }

    /// Returns the variance of the surface's true second differences around each pixel, relative to the prior's.
    ///
    /// With H the data's information, Q = DᵀWD and Σ = (H + Q)⁻¹, the solution for a true surface of covariance γ Q⁻¹
    /// has the expected energy E = f tr(QΣHΣ) + γ tr(HΣHΣ), where f, `noise_ratio`, is the noise's variance over that
    /// of its model. That is solved for γ, which is 0 at least. Away from edges of the surface, all of this is taken of
    /// second differences less their mean over [`square()`]: what does not change within it is not smoothed away. Beside a
    /// silhouette, where surfaces bend out of sight, it does change.
    ///
    /// So many independent differences that are as the prior allows are `assumed` beside those of the square: under a
    /// stiff prior it has few, which chance makes large or small.
    pub fn prior_scale(&self, prior: &ThinPlatePrior, x: &[f32], noise_ratio: &[f32], assumed: f32) -> Vec<f32> {
        let (zones, inner) = (&self.zones, self.zones.innermost());
        let assumed = assumed / (2.0 * ROUGHNESS_RADIUS as f32 + 1.0).powi(2);
        let scales = |found: &[f32], expected: &Energies, of_inner: bool| -> Vec<f32> {
            let mean = |map: &[f32]| zones.mean_at(map, |i| inner[i] == of_inner);
            let [found, noise, surface] = [found, &expected.noise, &expected.surface].map(mean);
            let beside_noise = |i: usize| found[i] - noise_ratio[i] * noise[i];
            let scale = |i: usize| ((beside_noise(i) + assumed) / (surface[i] + assumed)).max(0.0);
            (0..found.len()).map(|i| if surface[i] > 0.0 { scale(i) } else { 1.0 }).collect()
        };
        let no_mean = vec![0.0; x.len()];
        let whole = scales(&prior.energy(x, |_, _| no_mean.clone()), &self.whole, false);
        let rest = scales(&prior.energy(x, |d, weights| self.means(prior, inner, d, weights)), &self.rest, true);
        (0..x.len()).map(|i| if inner[i] { rest[i] } else { whole[i] }).collect()
    }

    /// Returns whether a pixel lies within 3 px of an edge of the surface.
    pub fn is_beside_edge(&self, i: usize) -> bool {
        self.zones.is_outermost(i)
    }

    /// Returns the mean of second differences around each of some pixels, over [`square()`], each by its weight: where
    /// the prior breaks they tell nothing. 0 at the other pixels.
    fn means(&self, prior: &ThinPlatePrior, some: &[bool], differences: &[f32], weights: &[f32]) -> Vec<f32> {
        let [w, h] = [prior.width, prior.height];
        let of_some = |i: usize, v: f32| if some[i] { v } else { 0.0 };
        // Not the smallest: square() is larger.
        let means: [Vec<f32>; RADII.len()] = std::array::from_fn(|level| {
            if level == 0 {
                return Vec::new();
            }
            let mut sum: Vec<f32> = (0..some.len()).map(|i| of_some(i, differences[i] * weights[i])).collect();
            let mut weight: Vec<f32> = weights.iter().enumerate().map(|(i, w)| of_some(i, *w)).collect();
            box_mean(&mut sum, w, h, RADII[level]);
            box_mean(&mut weight, w, h, RADII[level]);
            sum.iter().zip(&weight).map(|(s, w)| if *w > 0.0 { s / w } else { 0.0 }).collect()
        });
        let mean = |i: usize| over(square(self.pixels[i]).powi(2), |level| means[level][i]);
        (0..some.len()).map(|i| if some[i] { mean(i) } else { 0.0 }).collect()
    }
}

/// Returns what [`RADII`] have, `of` level, over a square of so many pixels.
fn over(pixels: f32, of: impl Fn(usize) -> f32) -> f32 {
    let radius = 0.5 * (pixels.max(1.0).sqrt() - 1.0);
    let at = radius.max(1.0).log2().min((RADII.len() - 1) as f32);
    let level = (at as usize).min(RADII.len() - 2);
    let part = at - level as f32;
    (1.0 - part) * of(level) + part * of(level + 1)
}
