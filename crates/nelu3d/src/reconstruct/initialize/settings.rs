//! Settings of the initial surface.

use serde::Serialize;

/// Settings of the propagation of the previous frame's surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PropagationSettings {
    /// Number of depth hypotheses on either side of the previous surface.
    pub search_range: i32,
    /// Radius of the squares that move alike, px; larger where single pixels are noisy.
    pub radius: usize,
    /// Radius over which offsets are averaged, px: the previous surface keeps its shape, and the noise of one pixel's
    /// offset is averaged out.
    pub smoothing_radius: usize,
    /// Mean χ² per measurement above which the previous surface is wrong, as a multiple of the median one.
    pub max_chi2_ratio: f32,
    /// Radius by which wrong regions are widened, px.
    pub margin: usize,
    /// Fraction of the pixels without a depth near the previous surface above which all are decoded anew.
    pub max_decoded: f32,
}

impl Default for PropagationSettings {
    fn default() -> Self {
        Self { search_range: 10, radius: 2, smoothing_radius: 5, max_chi2_ratio: 3.0, margin: 4, max_decoded: 0.4 }
    }
}

/// Settings of the estimation of the crosstalk matrix, and when it is accepted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CrosstalkSettings {
    /// Largest number of times that matrix and surface are estimated by turns.
    pub max_rounds: usize,
    /// Smallest fraction of χ² that crosstalk must explain.
    pub min_explained: f32,
    /// Largest change of an entry at which the matrix has settled.
    pub settled: f32,
}

impl Default for CrosstalkSettings {
    fn default() -> Self {
        Self { max_rounds: 3, min_explained: 0.1, settled: 0.01 }
    }
}
