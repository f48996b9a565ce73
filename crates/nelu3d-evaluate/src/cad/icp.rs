//! Iterated closest points: point to plane (Chen and Medioni 1992), with Geman-McClure weights whose scale shrinks.

use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;

use super::CadSurface;
use super::sample::OrientedPoint;

/// Returns the cosine of the angle between normals beyond which they belong to different surfaces: cos 60°.
pub(super) const MIN_NORMAL_AGREEMENT: f64 = 0.5;

/// How the scale of the robust weights shrinks from iteration to iteration.
#[derive(Clone, Copy, Debug)]
pub(super) struct IcpSchedule {
    /// Residual at which the weight of a point has dropped to a quarter, mm, in the first iteration.
    pub(super) first: f64,
    /// Residual at which the weight of a point has dropped to a quarter, mm, in the last iterations.
    pub(super) last: f64,
    /// Factor of that residual from one iteration to the next.
    pub(super) shrink: f64,
    /// Maximum number of iterations.
    pub(super) iterations: usize,
}

/// Moves `pose` (`cam_from_cad`) until the points of the scan lie on the surface as well as they can.
pub(super) fn refine(
    surface: &CadSurface,
    scan: &[OrientedPoint],
    pose: &Isometry3<f64>,
    schedule: &IcpSchedule,
) -> Isometry3<f64> {
    let mut cad_from_cam = pose.inverse();
    let mut scale = schedule.first;
    let done = 1e-7 * surface.diagonal();
    for _ in 0..schedule.iterations {
        let Some((step, motion)) = step(surface, scan, &cad_from_cam, scale) else { break };
        cad_from_cam = step * cad_from_cam;
        if scale <= schedule.last && motion < done {
            break;
        }
        scale = (scale * schedule.shrink).max(schedule.last);
    }
    cad_from_cam.inverse()
}

/// Computes one Gauss-Newton step in the mesh's frame, and about how far it moves the points at most, mm.
fn step(
    surface: &CadSurface,
    scan: &[OrientedPoint],
    cad_from_cam: &Isometry3<f64>,
    scale: f64,
) -> Option<(Isometry3<f64>, f64)> {
    let reach = 4.0 * scale;
    // Blocks of fixed size, summed in their order: the same pose with any number of threads.
    let blocks: Vec<_> = scan
        .par_chunks(512)
        .map(|points| {
            let pairs = points.iter().filter_map(|o| {
                let q = o.transformed(cad_from_cam);
                let c = surface.closest(&q.point, reach)?;
                if c.on_border || agreement(surface, &c.normal, &q.normal) < MIN_NORMAL_AGREEMENT {
                    return None;
                }
                let d2 = c.distance * c.distance;
                let weight = (scale * scale / (scale * scale + d2)).powi(2);
                Some((q.point, c.normal, c.normal.dot(&(q.point - c.point)), weight))
            });
            pairs.collect::<Vec<_>>()
        })
        .collect();
    let pairs: Vec<_> = blocks.into_iter().flatten().collect();
    if pairs.len() < 6 {
        return None;
    }
    let sum = pairs.iter().fold(Vector3::zeros(), |s, p| s + p.0.coords);
    let center = Point3::from(sum / pairs.len() as f64);
    // Rotations are measured in mm of motion at this arm, so that both halves of the system are of one size.
    let arm = 0.25 * surface.diagonal();
    let (mut a, mut b) = (Matrix6::zeros(), Vector6::zeros());
    for (q, normal, residual, weight) in &pairs {
        let turn = (q - center).cross(normal) / arm;
        let row = Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z);
        a += row * row.transpose() * *weight;
        b -= row * (*residual * *weight);
    }
    // Motions along which the surface slides on itself (all turns of a sphere) cost nothing and must stay zero.
    a += Matrix6::identity() * (1e-6 * a.trace());
    let x = a.cholesky()?.solve(&b);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(x[0], x[1], x[2]) / arm);
    let shift = Translation3::new(x[3], x[4], x[5]);
    let about_center = Translation3::from(center.coords) * turn * Translation3::from(-center.coords);
    Some((shift * about_center, x.norm()))
}

/// Returns the cosine of the angle between the mesh's normal and the scan's; without a sign where the mesh has no
/// outside.
pub(super) fn agreement(surface: &CadSurface, cad: &Vector3<f64>, scan: &Vector3<f64>) -> f64 {
    let cos = cad.dot(scan);
    if surface.closed() { cos } else { cos.abs() }
}
