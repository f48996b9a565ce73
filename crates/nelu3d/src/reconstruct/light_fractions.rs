//! The fractions of a pixel's light that did not come directly from the light source, as a small linear problem.

use serde::Serialize;

use crate::sensor::Measurements;

/// Prior standard deviations of the fractions of light that did not come directly from the light source.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LightFractionPrior {
    /// Ambient fraction, in a scene without a black image.
    pub sigma_ambient: f32,
    /// Fraction of interreflection.
    pub sigma_indirect: f32,
}

impl LightFractionPrior {
    /// One over the prior variances of the two fractions: ambient light (codeword 1) and interreflection (the codeword of
    /// the surroundings). With a black image of the scene there is no ambient light left.
    pub(crate) fn weights(&self, m: &Measurements) -> [f32; 2] {
        let ambient = if m.has_black { 1e12 } else { 1.0 / (self.sigma_ambient * self.sigma_ambient) };
        [ambient, 1.0 / (self.sigma_indirect * self.sigma_indirect)]
    }
}

/// Normal equations of the two fractions (a of ambient light, b of interreflection) in
/// `p − c = a (1 − c) + b (surround − c)`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LightFractionEquations {
    /// Entries aa, ab, bb of the matrix, then the right-hand side.
    pub(crate) sums: [f32; 5],
}

impl LightFractionEquations {
    /// Adds a measurement: residual `r` = a · `ambient` + b · `indirect`, with weight `iv`.
    #[inline]
    pub(crate) fn add(&mut self, r: f32, ambient: f32, indirect: f32, iv: f32) {
        self.sums[0] += iv * ambient * ambient;
        self.sums[1] += iv * ambient * indirect;
        self.sums[2] += iv * indirect * indirect;
        self.sums[3] += iv * ambient * r;
        self.sums[4] += iv * indirect * r;
    }

    /// The best fractions that are not negative (nor most of the light), and by how much they lower χ².
    #[inline]
    pub(crate) fn solve(&self, prior: [f32; 2]) -> ([f32; 2], f32) {
        let [aa, ab, bb, f, g] = self.sums;
        let (a, c) = (aa + prior[0], bb + prior[1]);
        let det = a * c - ab * ab;
        let mut x = [(c * f - ab * g) / det, (a * g - ab * f) / det];
        if x[0] < 0.0 {
            x = [0.0, (g / c).max(0.0)];
        } else if x[1] < 0.0 {
            x = [(f / a).max(0.0), 0.0];
        }
        x = x.map(|v| v.min(0.45));
        let gain = 2.0 * (x[0] * f + x[1] * g) - a * x[0] * x[0] - c * x[1] * x[1] - 2.0 * ab * x[0] * x[1];
        (x, gain)
    }
}
