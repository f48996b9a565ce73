//! The prior of the fractions of a pixel's light that did not come directly from the light source.

use serde::Serialize;

use crate::sensor::Measurements;

/// Prior standard deviations of the fractions of light that did not come directly from the light source.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LightFractionPrior {
    /// Prior standard deviation of the ambient fraction, in a scene without a black image.
    pub sigma_ambient: f32,
    /// Prior standard deviation of the fraction of interreflection.
    pub sigma_indirect: f32,
}

impl LightFractionPrior {
    /// What most scenes have.
    pub(crate) const USUAL: Self = Self { sigma_ambient: 0.05, sigma_indirect: 0.2 };

    /// Returns one over the prior variances of the two fractions: ambient light (codeword 1) and interreflection (the
    /// codeword of the surroundings). With a black image of the scene there is no ambient light left.
    pub fn weights(&self, m: &Measurements) -> [f32; 2] {
        let ambient = if m.has_black { 1e12 } else { 1.0 / (self.sigma_ambient * self.sigma_ambient) };
        [ambient, 1.0 / (self.sigma_indirect * self.sigma_indirect)]
    }
}
