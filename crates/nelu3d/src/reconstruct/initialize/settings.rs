//! Settings of the initial surface.

use serde::Serialize;

/// How the previous frame's surface is propagated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PropagationSettings {
    /// Number of depth hypotheses on either side of the previous surface.
    pub search_range: i32,
    /// Radius of the squares that move alike, px; larger where one pixel says little.
    pub radius: usize,
    /// Radius over which the previous surface moves as a whole, px: it keeps its shape, and the noise of one pixel's
    /// offset is averaged out.
    pub smoothing_radius: usize,
    /// Mean χ² per measurement above which the previous surface is wrong, as a multiple of the typical one.
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

/// When an estimated crosstalk matrix is accepted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CrosstalkSettings {
    /// Largest number of times that surface and matrix are found by turns.
    pub max_rounds: usize,
    /// Least part of the misfit that crosstalk must explain.
    pub min_explained: f32,
    /// Largest change of an entry at which the matrix has settled.
    pub settled: f32,
}

impl Default for CrosstalkSettings {
    fn default() -> Self {
        Self { max_rounds: 3, min_explained: 0.1, settled: 0.01 }
    }
}
