//! Settings of the cost volume, and the penalties that follow from them.

use serde::Serialize;

/// Settings of the cost volume and of semi-global matching.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CostVolumeSettings {
    /// Largest number of depth hypotheses.
    pub max_hypotheses: usize,
    /// Prior probability that neighbors differ by a depth jump.
    pub p_jump: f32,
    /// Prior probability that neighbors differ by one hypothesis.
    pub p_step: f32,
}

/// Penalties on neighbors that differ in depth, χ²: −2 log of the prior probability.
pub(super) struct Penalties {
    /// Penalty on a difference of one hypothesis.
    pub(super) step: f32,
    /// Penalty on a larger difference.
    pub(super) jump: f32,
}

impl Penalties {
    /// Returns the penalties for a number of hypotheses.
    pub(super) fn new(s: &CostVolumeSettings, hypotheses: usize) -> Self {
        Self { step: -2.0 * (s.p_step / (1.0 - 2.0 * s.p_step)).ln(), jump: -2.0 * (s.p_jump / hypotheses as f32).ln() }
    }
}
