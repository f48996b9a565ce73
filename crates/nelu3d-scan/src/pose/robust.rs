//! Small robust statistics.

use crate::statistics;

/// Returns the median of a sample that stays as it is; 0 for an empty one.
pub(crate) fn median(values: &[f64]) -> f64 {
    statistics::median(&mut values.to_vec()).unwrap_or(0.0)
}

/// Returns σ of one coordinate from the norms of two-dimensional residuals: the median of a Rayleigh variable is 1.1774
/// σ.
pub(crate) fn sigma_of_norms(norms: &[f64]) -> f64 {
    median(norms) / 1.1774
}

/// Returns Huber's weight of a residual of this norm.
pub(crate) fn huber(norm: f64, limit: f64) -> f64 {
    if norm <= limit { 1.0 } else { limit / norm }
}

/// Knuth's 64-bit linear congruential generator: enough to draw subsets, the same on every machine.
pub(crate) struct Lcg(u64);

impl Lcg {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed ^ 0x9e37_79b9_7f4a_7c15)
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n
    }
}
