//! How well a pose explains a scan: what lies on the mesh, and what of the mesh the camera would have seen through.

use nalgebra::{Isometry3, Point3};

use super::icp::{MIN_NORMAL_AGREEMENT, agreement};
use super::sample::OrientedPoint;
use super::{CadSurface, ScanMaps};

/// How well a pose explains a scan, by samples of both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PoseScore {
    /// Mean over the scan of the distance, cut at the tolerance, in tolerances: 0 if all lies on the mesh, 1 if nothing
    /// does.
    pub(super) off: f64,
    /// Fraction of the mesh's samples facing the camera that lie in front of what was measured, which is impossible.
    pub(super) in_front: f64,
    /// Fraction of the mesh's samples facing the camera where nothing was measured.
    pub(super) unseen: f64,
    /// Fraction of the samples where something was measured, and which are not hidden behind it, that lie on it.
    pub(super) explained: f64,
    /// Fraction of the samples facing the camera that lie on what was measured; hidden ones count as lost.
    pub(super) on: f64,
}

impl PoseScore {
    /// Returns the cost of the pose: smaller is better.
    pub(super) fn cost(&self) -> f64 {
        // Pixels without depth may be dark or ambiguous: they speak against a pose, but not loudly.
        self.off + self.in_front + 0.3 * self.unseen
    }
}

/// Scores `pose` (`cam_from_cad`) with a tolerance in mm.
pub(super) fn score(
    surface: &CadSurface,
    model: &[OrientedPoint],
    scan: &ScanMaps<'_>,
    points: &[OrientedPoint],
    pose: &Isometry3<f64>,
    tolerance: f64,
) -> PoseScore {
    let cad_from_cam = pose.inverse();
    let off = |o: &OrientedPoint| {
        let q = o.transformed(&cad_from_cam);
        match surface.closest(&q.point, tolerance) {
            Some(c) if agreement(surface, &c.normal, &q.normal) >= MIN_NORMAL_AGREEMENT => c.distance.abs() / tolerance,
            _ => 1.0,
        }
    };
    let (mut facing, mut in_front, mut unseen, mut on) = (0.0, 0.0, 0.0, 0.0);
    for m in model {
        let p = m.transformed(pose);
        // Open meshes have two sides, and one of them faces the camera.
        let towards = -p.normal.dot(&p.point.coords.normalize());
        let towards = if surface.closed() { towards } else { towards.abs() };
        if towards <= 0.1 {
            continue;
        }
        let Some(depth) = depth_at(scan, &p.point) else { continue };
        facing += 1.0;
        // Along the normal: depth differs by more where the surface is slanted.
        let behind = (p.point.z - depth) * towards;
        if !depth.is_finite() {
            unseen += 1.0;
        } else if behind < -2.0 * tolerance {
            in_front += 1.0;
        } else if behind <= tolerance {
            on += 1.0;
        }
    }
    let fraction = |n: f64, of: f64| if of > 0.0 { n / of } else { 0.0 };
    PoseScore {
        off: points.iter().map(off).sum::<f64>() / points.len().max(1) as f64,
        // Nothing of the mesh in the image explains nothing.
        in_front: if facing > 0.0 { in_front / facing } else { 1.0 },
        unseen: fraction(unseen, facing),
        explained: fraction(on, on + in_front),
        on: fraction(on, facing),
    }
}

/// Returns the measured depth where a point of the camera's frame is seen; NaN where nothing was measured, `None`
/// outside of the image.
fn depth_at(scan: &ScanMaps<'_>, p: &Point3<f64>) -> Option<f64> {
    let [u, v] = scan.camera.project(p)?;
    let (x, y) = (u.round(), v.round());
    let inside = x >= 0.0 && y >= 0.0 && x < scan.camera.width as f64 && y < scan.camera.height as f64;
    inside.then(|| f64::from(scan.depth[y as usize * scan.camera.width + x as usize]))
}
