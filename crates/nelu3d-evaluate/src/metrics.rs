//! The errors of a result, by region.

use crate::stats::ErrorStatistics;

/// Errors of a result, by region. A number that no pixel could give is NaN (`null` in JSON).
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Metrics {
    /// Errors over all pixels of the ground truth's mask.
    pub whole: RegionMetrics,
    /// Errors over the mask without [`BODY_MARGIN_PX`](crate::BODY_MARGIN_PX) pixels next to silhouettes, shadow
    /// borders and depth jumps.
    pub body: RegionMetrics,
    /// Errors over the mask's pixels whose surface is seen at more than [`GRAZING_DEG`](crate::GRAZING_DEG).
    pub grazing: RegionMetrics,
    /// Number of pixels that have a depth although the ground truth has no surface there, or none that the light source
    /// reaches.
    pub n_outside_mask: usize,
}

/// Errors in one region.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RegionMetrics {
    /// Number of pixels of the region.
    pub n_region: usize,
    /// Number of pixels of the region that have a result: those the errors are taken over.
    pub n: usize,
    /// Coverage, `n / n_region`.
    pub coverage: f64,
    /// Depth errors, result − ground truth, mm.
    pub depth_mm: ErrorStatistics,
    /// Fraction of the `n` pixels whose depth is off by less than 0.5 mm.
    pub under_half_mm: f64,
    /// Fraction of the `n` pixels whose depth is off by less than 1 mm.
    pub under_1mm: f64,
    /// Fraction of all `n_region` pixels that have a depth which is off by 2 mm or more.
    pub over_2mm: f64,
    /// Errors in projector columns, result − ground truth, px: present when a projector was given.
    pub disparity_px: Option<ErrorStatistics>,
    /// Angles between the result's normals and those of the ground truth's depth, degrees: present when normals were
    /// given.
    pub normal_deg: Option<ErrorStatistics>,
    /// How well the 1σ of the depth is calibrated: present when the result has one.
    pub sigma: Option<UncertaintyCalibration>,
}

/// How often errors stay within the uncertainty that was claimed. Gaussian errors would give 0.683 and 0.954.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct UncertaintyCalibration {
    /// Fraction of pixels with |error| ≤ 1σ.
    pub within_1: f64,
    /// Fraction of pixels with |error| ≤ 2σ.
    pub within_2: f64,
    /// Fraction of all `n_region` pixels that have a depth which is off by 2 mm or more and by more than 10σ.
    pub gross: f64,
    /// Median 1σ, mm.
    pub median_mm: f64,
}
