//! A result against ground truth.

use nelu3d_scan::statistics::percentile;
use nelu3d_scan::{Camera, Projector};
use rayon::prelude::*;

use crate::metrics::{Metrics, RegionMetrics, UncertaintyCalibration};
use crate::stats::ratio;
use crate::{ErrorStatistics, GroundTruth, Regions};

/// The maps of a result that is evaluated: `height × width` each, row by row.
#[derive(Clone, Copy, Debug)]
pub struct EvaluatedMaps<'a> {
    /// Depth (camera z), mm; NaN where there is none.
    pub depth: &'a [f32],
    /// Unit normals that face the camera.
    pub normals: Option<&'a [[f32; 3]]>,
    /// One standard deviation of the depth, mm.
    pub sigma: Option<&'a [f32]>,
}

/// Evaluates a result against ground truth. `regions` are [`GroundTruth::regions`] for the same camera; with a
/// projector, errors are measured in its columns, too.
///
/// # Panics
/// Panics when a map has another size than the ground truth.
pub fn evaluate(
    maps: &EvaluatedMaps<'_>,
    truth: &GroundTruth,
    regions: &Regions,
    camera: &Camera,
    projector: Option<&Projector>,
) -> Metrics {
    let n = truth.width * truth.height;
    assert_eq!(maps.depth.len(), n, "depth map and ground truth differ in size");
    assert!(maps.normals.is_none_or(|m| m.len() == n), "normal map and ground truth differ in size");
    assert!(maps.sigma.is_none_or(|m| m.len() == n), "sigma map and ground truth differ in size");
    assert_eq!((camera.width, camera.height), (truth.width, truth.height), "camera and ground truth differ in size");
    let columns = projector.map(|p| column_errors(maps.depth, truth, camera, p));
    let region = |inside: &[bool]| evaluate_region(maps, truth, regions, columns.as_deref(), inside);
    Metrics {
        whole: region(&truth.mask),
        body: region(&regions.body),
        grazing: region(&regions.grazing),
        n_outside_mask: (0..n).filter(|&i| !truth.mask[i] && maps.depth[i].is_finite()).count(),
    }
}

/// Evaluates the pixels of one region.
fn evaluate_region(
    maps: &EvaluatedMaps<'_>,
    truth: &GroundTruth,
    regions: &Regions,
    columns: Option<&[f64]>,
    inside: &[bool],
) -> RegionMetrics {
    let n_region = inside.iter().filter(|&&m| m).count();
    let pixels: Vec<usize> = (0..inside.len()).filter(|&i| inside[i] && maps.depth[i].is_finite()).collect();
    let error = |i: usize| f64::from(maps.depth[i]) - f64::from(truth.depth[i]);
    let fraction = |f: &dyn Fn(usize) -> bool| ratio(pixels.iter().filter(|&&i| f(i)).count(), pixels.len());
    let of_region = |f: &dyn Fn(usize) -> bool| ratio(pixels.iter().filter(|&&i| f(i)).count(), n_region);
    RegionMetrics {
        n_region,
        n: pixels.len(),
        coverage: ratio(pixels.len(), n_region),
        depth_mm: ErrorStatistics::of(pixels.iter().map(|&i| error(i)).collect()),
        under_half_mm: fraction(&|i| error(i).abs() < 0.5),
        under_1mm: fraction(&|i| error(i).abs() < 1.0),
        over_2mm: of_region(&|i| error(i).abs() >= 2.0),
        disparity_px: columns
            .map(|c| ErrorStatistics::of(pixels.iter().map(|&i| c[i]).filter(|e| e.is_finite()).collect())),
        normal_deg: maps.normals.map(|normals| {
            let angle = |i: usize| angle_deg(normals[i], regions.normals[i]);
            ErrorStatistics::of(pixels.iter().map(|&i| angle(i)).filter(|a| a.is_finite()).collect())
        }),
        sigma: maps.sigma.map(|sigma| UncertaintyCalibration {
            within_1: fraction(&|i| error(i).abs() <= f64::from(sigma[i])),
            within_2: fraction(&|i| error(i).abs() <= 2.0 * f64::from(sigma[i])),
            gross: of_region(&|i| error(i).abs() >= 2.0 && error(i).abs() > 10.0 * f64::from(sigma[i])),
            median_mm: percentile(&mut pixels.iter().map(|&i| f64::from(sigma[i])).collect::<Vec<_>>(), 50.0),
        }),
    }
}

/// Returns the projector column of the result's point minus that of the ground truth, px, for every pixel; NaN where
/// one of them is missing.
fn column_errors(depth: &[f32], truth: &GroundTruth, camera: &Camera, projector: &Projector) -> Vec<f64> {
    let column = |px: usize, z: f32| {
        let ray = camera.ray([(px % truth.width) as f64, (px / truth.width) as f64]);
        projector.project(&ray.at(f64::from(z) / ray.dir.z)).map_or(f64::NAN, |p| p[0])
    };
    let error = |i: usize| {
        let (found, expected) = (depth[i], truth.depth[i]);
        if found.is_finite() && expected.is_finite() { column(i, found) - column(i, expected) } else { f64::NAN }
    };
    (0..depth.len()).into_par_iter().map(error).collect()
}

/// Returns the angle between two vectors of any length, 0° to 180°.
pub fn angle_deg(a: [f32; 3], b: [f32; 3]) -> f64 {
    let v = |n: [f32; 3]| nalgebra::Vector3::new(f64::from(n[0]), f64::from(n[1]), f64::from(n[2]));
    // atan2 keeps its precision at small angles, where acos of a dot product loses half the digits.
    v(a).cross(&v(b)).norm().atan2(v(a).dot(&v(b))).to_degrees()
}
