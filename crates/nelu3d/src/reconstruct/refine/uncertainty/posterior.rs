//! Variances that noise and prior leave in the solution of the linear system.

use nelu3d_scan::image::box_mean;

use super::information::Information;
use super::masked_mean::masked_mean;
use super::uniform_plate::FrequencyMeans;
use super::zones::Zones;
use crate::reconstruct::refine::thin_plate::ThinPlatePrior;

/// Radius over which a pixel's weight and information are averaged, px.
const LOCAL_RADIUS: usize = 1;
/// Radius over which information is averaged where pixels themselves have next to none, px.
const FAR_RADIUS: usize = 8;
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
    /// Energy of the noise.
    noise_energy: Vec<f32>,
    /// Energy of a surface that is as rough as the prior allows.
    prior_energy: Vec<f32>,
}

impl Posterior {
    /// Takes the variances and energies of a uniform plate around every pixel.
    pub fn new(prior: &ThinPlatePrior, information: &[Information]) -> Self {
        let (w, h, n) = (prior.width, prior.height, information.len());
        let data: Vec<f32> = information.iter().map(|i| i.h).collect();
        let near = masked_mean(&data, &prior.active, w, h, LOCAL_RADIUS);
        let far = masked_mean(&data, &prior.active, w, h, FAR_RADIUS);
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
        let mut out = Self { noise: zero(), prior: zero(), pixels: zero(), noise_energy: zero(), prior_energy: zero() };
        for i in (0..n).filter(|i| prior.active[*i]) {
            // A pixel that measures nothing has a hundredth of the information around it.
            let h = near[i].max(0.01 * far[i]).max(1e-12);
            let weight = if has_weight[i] > 1e-6 { weight[i].exp() } else { 0.0 };
            let means = FrequencyMeans::at(weight / h);
            let edge = 1.0 + EDGE * (2.0 * (1.0 - support[i]).max(0.0)).sqrt();
            out.noise[i] = edge * means.noise / h;
            out.prior[i] = edge * means.prior / h;
            out.pixels[i] = 1.0 / means.noise.max(1e-6);
            out.noise_energy[i] = means.prior;
            out.prior_energy[i] = means.noise;
        }
        out
    }

    /// Returns the variance of the surface's true second differences around each pixel, relative to the prior's.
    ///
    /// With H the data's information, Q = DᵀWD and Σ = (H + Q)⁻¹, the solution for a true surface of covariance γ Q⁻¹
    /// has the expected energy E = f tr(QΣHΣ) + γ tr(HΣHΣ), where f, `noise_ratio`, is the noise's variance over that
    /// of its model. That is solved for γ.
    pub(super) fn prior_scale(&self, prior: &ThinPlatePrior, x: &[f32], noise_ratio: &[f32]) -> Vec<f32> {
        let zones = Zones::new(&prior.active, [prior.width, prior.height], ROUGHNESS_RADIUS);
        let (found, noise) = (zones.mean(&prior.energy(x)), zones.mean(&self.noise_energy));
        let rough = zones.mean(&self.prior_energy);
        let scale = |i: usize| {
            if rough[i] > 0.0 { ((found[i] - noise_ratio[i] * noise[i]) / rough[i]).clamp(0.0, 1.0) } else { 1.0 }
        };
        (0..found.len()).map(scale).collect()
    }
}
