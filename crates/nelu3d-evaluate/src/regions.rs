//! The parts of a scene that are evaluated separately.

use nalgebra::Vector3;
use nelu3d_scan::Camera;
use rayon::prelude::*;

use crate::{GroundTruth, depth_jumps};

/// Distance (Chebyshev) from a silhouette, a shadow border or a depth jump within which pixels do not count as body,
/// px.
pub const BODY_MARGIN_PX: usize = 3;

/// Angle between normal and viewing ray above which a surface is seen at a grazing angle, degrees.
pub const GRAZING_DEG: f64 = 70.0;

/// The regions of a scene that errors are measured in, `height × width` each.
#[derive(Clone, Debug)]
pub struct Regions {
    /// Pixels of the mask without [`BODY_MARGIN_PX`] pixels next to silhouettes, shadow borders and depth jumps. The
    /// border of the image is no silhouette.
    pub body: Vec<bool>,
    /// Pixels of the mask that are seen at more than [`GRAZING_DEG`].
    pub grazing: Vec<bool>,
    /// Unit normals of the ground truth, facing the camera; NaN where there is none.
    pub normals: Vec<[f32; 3]>,
}

impl GroundTruth {
    /// Divides the scene into the regions that a result is evaluated in.
    ///
    /// # Panics
    ///
    /// Panics when the camera has another size than the ground truth.
    pub fn regions(&self, camera: &Camera) -> Regions {
        assert_eq!((camera.width, camera.height), (self.width, self.height), "camera and ground truth differ in size");
        let jumps = depth_jumps(&self.depth, self.width, self.height, camera.fx.min(camera.fy));
        let outside: Vec<bool> = self.mask.iter().map(|m| !m).collect();
        let near_outside = dilate(&outside, self.width, self.height, BODY_MARGIN_PX);
        // Both pixels of a jump are marked, so the first of the three pixels on either side is the mark itself.
        let near_jump = dilate(&jumps, self.width, self.height, BODY_MARGIN_PX - 1);
        let normals = normals_from_depth(&self.depth, camera, &jumps);
        let min_cos = GRAZING_DEG.to_radians().cos();
        let grazing = |i: usize| {
            let ray = camera.ray([(i % self.width) as f64, (i / self.width) as f64]);
            let [x, y, z] = normals[i].map(f64::from);
            -ray.dir.dot(&Vector3::new(x, y, z)) < min_cos
        };
        Regions {
            body: (0..self.mask.len()).map(|i| self.mask[i] && !near_outside[i] && !near_jump[i]).collect(),
            grazing: (0..self.mask.len()).into_par_iter().map(|i| self.mask[i] && grazing(i)).collect(),
            normals,
        }
    }
}

/// Computes the unit normals of a depth map, facing the camera: the cross product of its tangents along rows and
/// columns, central differences where both neighbors are on the same surface, one-sided elsewhere; NaN where a tangent
/// cannot be had.
///
/// `depth` is `height × width` of `camera`, mm; `jumps` as [`depth_jumps`] gives them.
pub fn normals_from_depth(depth: &[f32], camera: &Camera, jumps: &[bool]) -> Vec<[f32; 3]> {
    let (width, height) = (camera.width, camera.height);
    assert!(depth.len() == width * height && jumps.len() == depth.len(), "depth map of another size");
    let point = |i: usize| {
        let ray = camera.ray([(i % width) as f64, (i / width) as f64]);
        ray.dir * (f64::from(depth[i]) / ray.dir.z)
    };
    let points: Vec<Vector3<f64>> = (0..depth.len()).into_par_iter().map(point).collect();
    let tangent = |i: usize, has_before: bool, has_after: bool, stride: usize| -> Option<Vector3<f64>> {
        let difference = |a: usize, b: usize| {
            let d = points[b] - points[a];
            // Two marked neighbors may be the two sides of a jump.
            (d.x.is_finite() && !(jumps[a] && jumps[b])).then_some(d)
        };
        let before = if has_before { difference(i - stride, i) } else { None };
        let after = if has_after { difference(i, i + stride) } else { None };
        match (before, after) {
            (Some(a), Some(b)) => Some(a + b),
            (a, b) => a.or(b),
        }
    };
    let normal = |i: usize| {
        let (x, y) = (i % width, i / width);
        let along_row = tangent(i, x > 0, x + 1 < width, 1)?;
        let along_column = tangent(i, y > 0, y + 1 < height, width)?;
        let n = along_column.cross(&along_row).try_normalize(1e-12)?;
        let n = if n.dot(&points[i]) > 0.0 { -n } else { n };
        Some([n.x as f32, n.y as f32, n.z as f32])
    };
    (0..depth.len()).into_par_iter().map(|i| normal(i).unwrap_or([f32::NAN; 3])).collect()
}

/// Returns whether a marked pixel lies within `radius` (Chebyshev), separably.
fn dilate(marked: &[bool], width: usize, height: usize, radius: usize) -> Vec<bool> {
    let mut rows = vec![false; marked.len()];
    for y in 0..height {
        let row = &marked[y * width..(y + 1) * width];
        for x in 0..width {
            rows[y * width + x] = row[x.saturating_sub(radius)..(x + radius + 1).min(width)].contains(&true);
        }
    }
    let mut out = vec![false; marked.len()];
    for y in 0..height {
        for x in 0..width {
            out[y * width + x] = (y.saturating_sub(radius)..(y + radius + 1).min(height)).any(|v| rows[v * width + x]);
        }
    }
    out
}
