//! The comparison: check, align, measure, decide whether the pose is believed.

use nalgebra::{Isometry3, Point3};
use nelu3d::Progress;
use nelu3d_scan::Mesh;
use rayon::prelude::*;

use super::options::{CadOptions, InitialPose};
use super::pose::pose_rows;
use super::sample::{MIN_POINTS, OrientedPoint};
use super::scan::{ScanMaps, oriented_points, point_at, smoothed};
use super::score::PoseScore;
use super::search::PoseSearch;
use super::{CadError, CadErrors, CadMetrics, CadSurface};
use crate::stats::ratio;
use crate::{GroundTruth, Regions};

/// Fraction of the mesh's diagonal within which a point belongs to the part, unless the options say otherwise.
const DEFAULT_TOLERANCE: f64 = 0.01;
/// Least fraction of the scan that lies on the mesh, or of the visible mesh that was found, at a pose that is believed.
const MIN_BELIEVED: f64 = 0.5;
/// Greatest fraction of the mesh where the camera saw through, at a pose that is believed.
const MAX_IN_FRONT: f64 = 0.15;
/// Ratios of size beyond which mesh and scan must be in different units: a scan may have much around the part, and a
/// part may be much larger than what the camera sees of it.
const UNIT_RATIOS: [f64; 2] = [1.0 / 150.0, 60.0];
/// A comparison of a scan with a mesh.
pub struct CadComparison {
    /// The numbers of the comparison.
    pub metrics: CadMetrics,
    /// The pose `cam_from_cad`: from the mesh's frame, scaled, to the camera's, mm.
    pub pose: Isometry3<f64>,
    /// Signed distance from the mesh of every pixel's point, mm: positive outside, or, where the mesh bounds nothing,
    /// on the camera's side. NaN where there is no depth, or nothing of the mesh within reach.
    pub distances: Vec<f32>,
    /// The mesh as a surface that can be asked for distances.
    pub surface: CadSurface,
}

/// Compares a scan with a mesh.
///
/// # Errors
///
/// One of the two is empty, they are in different units, no pose explains the scan, or the work was cancelled.
///
/// # Panics
///
/// Panics when maps and camera differ in size.
pub fn compare_with_cad(
    scan: &ScanMaps<'_>,
    mesh: &Mesh,
    options: &CadOptions,
    progress: &Progress,
) -> Result<CadComparison, CadError> {
    let (width, height) = (scan.camera.width, scan.camera.height);
    assert_eq!(scan.depth.len(), width * height, "depth map and camera differ in size");
    assert!(scan.normals.is_none_or(|n| n.len() == width * height), "normal map and camera differ in size");
    progress.stage("prepare the mesh");
    let surface = CadSurface::new(mesh, options.scale).ok_or(CadError::EmptyMesh)?;
    // Regions of what was measured, as if the scan were the ground truth.
    let mask: Vec<bool> = scan.depth.iter().map(|z| z.is_finite()).collect();
    let regions = GroundTruth { width, height, depth: scan.depth.to_vec(), mask }.regions(scan.camera);
    let points: Vec<OrientedPoint> = match scan.normals {
        Some(normals) => oriented_points(scan, normals),
        None => oriented_points(scan, &smoothed(&regions.normals, width, height)),
    };
    if points.len() < MIN_POINTS {
        return Err(CadError::EmptyScan { found: points.len(), needed: MIN_POINTS });
    }
    check_unit(&surface, &points)?;
    let tolerance = options.within_mm.unwrap_or(DEFAULT_TOLERANCE * surface.diagonal());
    let search = PoseSearch::new(&surface, scan, &points, tolerance, options.seed);
    let pose = align(&search, options.start, tolerance, progress)?;

    progress.stage("measure distances");
    let distances = pixel_distances(scan, &surface, &pose);
    let score = search.score(&pose, tolerance);
    let metrics = metrics(&surface, options, &pose, &distances, &regions, &score, points.len(), tolerance);
    let believed = metrics.inliers.max(score.on) >= MIN_BELIEVED && score.in_front <= MAX_IN_FRONT;
    if options.start == InitialPose::Search && !believed {
        let PoseScore { on, in_front, .. } = score;
        return Err(CadError::NoPose { on_mesh: metrics.inliers, on, in_front, tolerance_mm: tolerance });
    }
    Ok(CadComparison { metrics, pose, distances, surface })
}

/// Finds or refines the pose, as far as the initial pose leaves that open.
fn align(
    search: &PoseSearch<'_>,
    start: InitialPose,
    tolerance: f64,
    progress: &Progress,
) -> Result<Isometry3<f64>, CadError> {
    Ok(match start {
        InitialPose::Fixed(pose) => pose,
        InitialPose::Near(pose) => {
            progress.stage("refine the pose");
            search.refine(&pose, 0.05 * search.surface.diagonal())
        }
        InitialPose::Search => {
            progress.stage("find the pose");
            let pose = search.everywhere(progress).ok_or(CadError::Cancelled)?;
            progress.stage("refine the pose");
            search.refine(&pose, tolerance)
        }
    })
}

/// Computes the numbers of a pose.
fn metrics(
    surface: &CadSurface,
    options: &CadOptions,
    pose: &Isometry3<f64>,
    distances: &[f32],
    regions: &Regions,
    score: &PoseScore,
    n_points: usize,
    tolerance: f64,
) -> CadMetrics {
    let errors = |keep: &dyn Fn(usize) -> bool| {
        let kept = (0..distances.len()).filter(|&i| keep(i)).map(|i| f64::from(distances[i]));
        CadErrors::of(kept.filter(|d| d.is_finite()).collect())
    };
    let of_part = |i: usize| f64::from(distances[i]).abs() <= tolerance;
    let part = errors(&of_part);
    CadMetrics {
        cam_from_cad: pose_rows(pose),
        scale: options.scale,
        aligned: !matches!(options.start, InitialPose::Fixed(_)),
        cad_diagonal_mm: surface.diagonal(),
        closed: surface.closed(),
        within_mm: tolerance,
        n_points,
        inliers: ratio(part.n, n_points),
        visible_found: score.explained,
        in_front: score.in_front,
        all: errors(&|_| true),
        part,
        body: errors(&|i| of_part(i) && regions.body[i]),
    }
}

/// Returns the signed distance of every pixel's point, mm.
fn pixel_distances(scan: &ScanMaps<'_>, surface: &CadSurface, pose: &Isometry3<f64>) -> Vec<f32> {
    let distance = |i: usize| {
        if scan.depth[i].is_finite() { surface.signed_distance(pose, &point_at(scan, i)) as f32 } else { f32::NAN }
    };
    (0..scan.depth.len()).into_par_iter().map(distance).collect()
}

/// Checks that mesh and scan are of comparable size.
fn check_unit(surface: &CadSurface, points: &[OrientedPoint]) -> Result<(), CadError> {
    let (mut low, mut high) = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    for o in points {
        (low, high) = (low.inf(&o.point), high.sup(&o.point));
    }
    let (mesh_mm, scan_mm) = (surface.diagonal(), (high - low).norm());
    let ratio = mesh_mm / scan_mm;
    if (UNIT_RATIOS[0]..=UNIT_RATIOS[1]).contains(&ratio) {
        return Ok(());
    }
    // Of meters, centimeters and micrometers, the one that brings both closest.
    let nearest = |&f: &f64| (ratio * f).ln().abs();
    let suggestion = [1000.0, 10.0, 0.1, 0.001].into_iter().min_by(|a, b| nearest(a).total_cmp(&nearest(b)));
    Err(CadError::Unit { mesh_mm, scan_mm, suggestion: suggestion.expect("a list of four") })
}
