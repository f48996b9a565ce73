//! Two results against each other.

use crate::stats::ErrorStatistics;

/// Differences of two depth maps, over the pixels that have a depth in both.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Comparison {
    /// Number of pixels that have a depth in both.
    pub n: usize,
    /// Number of pixels that have a depth in the first only.
    pub n_only_first: usize,
    /// Number of pixels that have a depth in the second only.
    pub n_only_second: usize,
    /// Differences, first − second, mm.
    pub depth_mm: ErrorStatistics,
}

/// Compares two depth maps of the same size.
///
/// # Panics
/// Panics when they differ in size.
pub fn compare(first: &[f32], second: &[f32]) -> Comparison {
    assert_eq!(first.len(), second.len(), "depth maps differ in size");
    let pairs = || first.iter().zip(second);
    let differences: Vec<f64> = pairs().map(|(&a, &b)| f64::from(a) - f64::from(b)).filter(|d| d.is_finite()).collect();
    Comparison {
        n: differences.len(),
        n_only_first: pairs().filter(|(a, b)| a.is_finite() && !b.is_finite()).count(),
        n_only_second: pairs().filter(|(a, b)| !a.is_finite() && b.is_finite()).count(),
        depth_mm: ErrorStatistics::of(differences),
    }
}
