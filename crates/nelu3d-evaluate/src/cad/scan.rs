//! The maps of a scan as points with normals.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Camera;
use rayon::prelude::*;

use super::sample::OrientedPoint;

/// The maps of a scan, `height × width` of the camera each, row by row.
#[derive(Clone, Copy, Debug)]
pub struct ScanMaps<'a> {
    /// The camera that took the scan.
    pub camera: &'a Camera,
    /// Depth (camera z), mm; NaN where there is none.
    pub depth: &'a [f32],
    /// Unit normals that face the camera; derived from the depth when there are none.
    pub normals: Option<&'a [[f32; 3]]>,
}

/// Returns the point of a pixel in the camera's frame, mm.
pub(super) fn point_at(scan: &ScanMaps<'_>, i: usize) -> Point3<f64> {
    let ray = scan.camera.ray([(i % scan.camera.width) as f64, (i / scan.camera.width) as f64]);
    ray.at(f64::from(scan.depth[i]) / ray.dir.z)
}

/// Returns the points of all pixels that have a depth and a normal.
pub(super) fn oriented_points(scan: &ScanMaps<'_>, normals: &[[f32; 3]]) -> Vec<OrientedPoint> {
    let one = |i: usize| {
        let [x, y, z] = normals[i].map(f64::from);
        let normal = Vector3::new(x, y, z).try_normalize(1e-6)?;
        (scan.depth[i].is_finite() && normal.x.is_finite()).then(|| OrientedPoint { point: point_at(scan, i), normal })
    };
    (0..scan.depth.len()).into_par_iter().filter_map(one).collect()
}

/// Averages normals over 5 × 5 pixels: those derived from depth alone are as noisy as its slope.
pub(super) fn smoothed(normals: &[[f32; 3]], width: usize, height: usize) -> Vec<[f32; 3]> {
    let mean = |i: usize| {
        let (x, y) = (i % width, i / width);
        if !normals[i][0].is_finite() {
            return [f32::NAN; 3];
        }
        let mut sum = Vector3::zeros();
        for v in y.saturating_sub(2)..(y + 3).min(height) {
            for u in x.saturating_sub(2)..(x + 3).min(width) {
                let n = Vector3::from(normals[v * width + u]);
                if n.x.is_finite() {
                    sum += n;
                }
            }
        }
        sum.try_normalize(1e-6).map_or([f32::NAN; 3], |n| [n.x, n.y, n.z])
    };
    (0..normals.len()).into_par_iter().map(mean).collect()
}
