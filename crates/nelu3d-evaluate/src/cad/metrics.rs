//! The numbers of a comparison with a mesh.

use crate::ErrorStatistics;
use crate::stats::ratio;

/// How far a scan is from a mesh. Distances are signed as in
/// [`CadComparison::distances`](super::CadComparison::distances), mm.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CadMetrics {
    /// Rows of the matrix `cam_from_cad` from the mesh's frame, after scaling, to the camera's, mm.
    pub cam_from_cad: [[f64; 4]; 4],
    /// Millimeters per unit of the mesh.
    pub scale: f64,
    /// Whether the pose was searched for or refined here, or taken as given.
    pub aligned: bool,
    /// Diagonal of the mesh's bounding box, mm.
    pub cad_diagonal_mm: f64,
    /// Whether the mesh bounds a volume, so that distances have an inside and an outside.
    pub closed: bool,
    /// Distance from the mesh within which a point belongs to the part, mm.
    pub within_mm: f64,
    /// Number of points of the scan.
    pub n_points: usize,
    /// Fraction of the points that belong to the part.
    pub inliers: f64,
    /// Fraction of the mesh facing the camera, and not hidden behind what was measured, that the scan has; estimated
    /// from samples.
    pub visible_found: f64,
    /// Fraction of the mesh facing the camera that lies in front of what was measured, which is impossible; estimated
    /// from samples.
    pub in_front: f64,
    /// Errors of all points, whatever they belong to.
    pub all: CadErrors,
    /// Errors of the part's points: those within `within_mm`.
    pub part: CadErrors,
    /// Errors of the part's points without [`BODY_MARGIN_PX`](crate::BODY_MARGIN_PX) pixels next to silhouettes, gaps
    /// and depth jumps of the scan.
    pub body: CadErrors,
}

/// Signed distances of some points from the mesh.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CadErrors {
    /// Number of points.
    pub n: usize,
    /// Statistics of the distances, mm.
    pub distance_mm: ErrorStatistics,
    /// Largest magnitude of a distance, mm.
    pub max_mm: f64,
    /// Fraction of the points closer than 0.5 mm.
    pub under_half_mm: f64,
    /// Fraction of the points closer than 1 mm.
    pub under_1mm: f64,
}

impl CadErrors {
    /// Computes the errors of finite signed distances, mm.
    pub fn of(distances: Vec<f64>) -> Self {
        let n = distances.len();
        let fraction = |limit: f64| ratio(distances.iter().filter(|d| d.abs() < limit).count(), n);
        let (under_half_mm, under_1mm) = (fraction(0.5), fraction(1.0));
        let max_mm = distances.iter().map(|d| d.abs()).fold(f64::NAN, f64::max);
        Self { n, distance_mm: ErrorStatistics::of(distances), max_mm, under_half_mm, under_1mm }
    }
}
