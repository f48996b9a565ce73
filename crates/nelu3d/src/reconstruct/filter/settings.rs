//! When a pixel is rejected after the refinement.

use serde::Serialize;

/// Settings of the rejection of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FilterSettings {
    /// Mean χ² per measurement over 5 × 5 pixels above which no surface explains the codeword.
    pub max_chi2: f32,
    /// χ² per measurement of a pixel at a depth discontinuity above which its codeword is a mixture of two surfaces.
    pub max_edge_chi2: f32,
    /// Median χ² per measurement of a connected component above which no part of it is explained: residuals of two
    /// standard deviations of noise and field error.
    pub max_component_chi2: f32,
    /// Median fraction of light of unseen origin (ambient light, interreflection from what the camera does not see) above
    /// which a component is at a wrong depth.
    pub max_component_unseen: f32,
    /// Smallest connected component that is valid, px.
    pub min_component: usize,
}

impl Default for FilterSettings {
    fn default() -> Self {
        Self {
            max_chi2: 40.0,
            max_edge_chi2: 9.0,
            max_component_chi2: 4.0,
            max_component_unseen: 0.25,
            min_component: 40,
        }
    }
}
