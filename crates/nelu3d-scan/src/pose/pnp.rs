//! The pose of a plane from its corners.

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6};

use super::PoseError;
use super::homography::Homography;
use super::robust::{huber, sigma_of_norms};
use crate::Camera;
use crate::board::Corner;
use crate::least_squares::{LmSettings, Problem, minimize};

/// A board's pose and how well it explains its corners.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseFit {
    /// Takes board coordinates to camera coordinates, mm.
    pub cam_from_board: Isometry3<f64>,
    /// Root mean square distance between seen and projected corners, px, over the corners used.
    pub rms_px: f64,
    /// Corners used.
    pub n_corners: usize,
    /// Corners rejected as outliers.
    pub n_rejected: usize,
    /// For each corner given, whether it was used.
    pub used: Vec<bool>,
}

/// Residual norms beyond this many σ are outliers; of good corners, 4e-5 are.
const REJECT_SIGMAS: f64 = 4.5;
/// No corner is better known than this, px: keeps the statistics of noise-free input finite.
const SIGMA_FLOOR_PX: f64 = 1e-6;

/// Solves for the pose that minimizes the reprojection error of a plane's corners under OpenCV's distortion model.
///
/// Starts from a robust homography of the undistorted corners, refines both of the poses a plane under weak perspective
/// can have (Schweighofer & Pinz 2006: mirror images of each other about the line of sight), keeps the better one, and
/// rejects corners that lie off by more than 4.5 robust σ. Needs at least 4 corners that do not lie on a line.
pub fn solve_pnp(corners: &[Corner], camera: &Camera) -> Result<PoseFit, PoseError> {
    let n = corners.len();
    if n < 4 {
        return Err(PoseError::TooFewCorners { found: n });
    }
    for (index, c) in corners.iter().enumerate() {
        if c.board_mm.iter().chain(&c.px).any(|v| !v.is_finite()) {
            return Err(PoseError::NotFinite { index });
        }
    }
    let plane: Vec<[f64; 2]> = corners.iter().map(|c| camera.undistort(c.px)).collect();
    let board: Vec<[f64; 2]> = corners.iter().map(|c| c.board_mm).collect();
    if flatness(&board) < 1e-3 || flatness(&plane) < 1e-3 {
        return Err(PoseError::Collinear { found: n });
    }
    let h = Homography::robust(&board, &plane).ok_or(PoseError::Collinear { found: n })?;
    let seed = from_homography(&h.matrix).ok_or(PoseError::NoSolution { found: n })?;

    let center = board.iter().fold([0.0; 2], |a, b| [a[0] + b[0] / n as f64, a[1] + b[1] / n as f64]);
    let candidates = [seed, mirrored(&seed, center)].map(|pose| refine_robust(corners, camera, &pose));
    let mut candidates: Vec<(Isometry3<f64>, f64)> = candidates.into_iter().flatten().collect();
    candidates.sort_by(|a, b| a.1.total_cmp(&b.1));
    let best_sigma = candidates.first().ok_or(PoseError::NoSolution { found: n })?.1;
    // Truncated squares at one common scale: the scale of either pose alone may hide its outliers.
    let cap = (REJECT_SIGMAS * best_sigma).powi(2);
    let cost = |pose: &Isometry3<f64>| norms(corners, camera, pose).iter().map(|r| (r * r).min(cap)).sum::<f64>();
    let pose = candidates.iter().map(|c| (cost(&c.0), c.0)).min_by(|a, b| a.0.total_cmp(&b.0));
    let (_, mut pose) = pose.ok_or(PoseError::NoSolution { found: n })?;

    let mut used = vec![true; n];
    // With fewer than six corners there is too little redundancy to tell a bad one.
    if n >= 6 {
        for _ in 0..3 {
            let r = norms(corners, camera, &pose);
            // The median over all corners: stays put when the first selection was too narrow.
            let limit = REJECT_SIGMAS * sigma_of_norms(&r).max(SIGMA_FLOOR_PX);
            used = r.iter().map(|&r| r <= limit).collect();
            let weights: Vec<f64> = used.iter().map(|&u| if u { 1.0 } else { 0.0 }).collect();
            pose = refine(corners, camera, &pose, &weights).ok_or(PoseError::NoSolution { found: n })?;
        }
    }
    let r = norms(corners, camera, &pose);
    let n_corners = used.iter().filter(|&&u| u).count();
    let sum: f64 = r.iter().zip(&used).filter(|(_, u)| **u).map(|(r, _)| r * r).sum();
    let rms_px = (sum / n_corners as f64).sqrt();
    if !rms_px.is_finite() {
        return Err(PoseError::NoSolution { found: n });
    }
    Ok(PoseFit { cam_from_board: pose, rms_px, n_corners, n_rejected: n - n_corners, used })
}

/// Returns the distance between seen and projected corners, px; infinite behind the camera.
pub(super) fn norms(corners: &[Corner], camera: &Camera, pose: &Isometry3<f64>) -> Vec<f64> {
    let norm = |c: &Corner| {
        let p = pose * Point3::new(c.board_mm[0], c.board_mm[1], 0.0);
        // Several times as fast as `hypot`, which guards against overflow.
        let length = |q: [f64; 2]| ((q[0] - c.px[0]).powi(2) + (q[1] - c.px[1]).powi(2)).sqrt();
        camera.project(&p).map_or(f64::INFINITY, length)
    };
    corners.iter().map(norm).collect()
}

/// Returns the ratio of a point set's extents: 0 on a line.
fn flatness(p: &[[f64; 2]]) -> f64 {
    let n = p.len() as f64;
    let (cx, cy) = (p.iter().map(|q| q[0]).sum::<f64>() / n, p.iter().map(|q| q[1]).sum::<f64>() / n);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for q in p {
        let (x, y) = (q[0] - cx, q[1] - cy);
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
    }
    let (mean, diff) = (0.5 * (xx + yy), (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt());
    if mean + diff > 0.0 { ((mean - diff).max(0.0) / (mean + diff)).sqrt() } else { 0.0 }
}

/// Splits a homography from the board to the image plane (K = I) into a rotation and a translation (Zhang 2000, §3.1).
fn from_homography(h: &Matrix3<f64>) -> Option<Isometry3<f64>> {
    let (a, b, t) = (h.column(0), h.column(1), h.column(2));
    let scale = 2.0 / (a.norm() + b.norm());
    let (a, b, t) = (a * scale, b * scale, t * scale);
    let svd = Matrix3::from_columns(&[a, b, a.cross(&b)]).svd(true, true);
    let r = svd.u? * svd.v_t?;
    if !(r.determinant() > 0.5 && t.iter().all(|v| v.is_finite())) {
        return None;
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
    Some(Isometry3::from_parts(Translation3::from(t), rotation))
}

/// Returns the other pose of a plane under weak perspective: its normal mirrored about the line of sight to its center.
fn mirrored(pose: &Isometry3<f64>, center: [f64; 2]) -> Isometry3<f64> {
    let c = Point3::new(center[0], center[1], 0.0);
    let at = (pose * c).coords;
    let sight = at.normalize();
    let normal = pose.rotation * Vector3::z();
    let other = 2.0 * normal.dot(&sight) * sight - normal;
    let turn = UnitQuaternion::rotation_between(&normal, &other).unwrap_or_default();
    let rotation = turn * pose.rotation;
    Isometry3::from_parts(Translation3::from(at - rotation * c.coords), rotation)
}

/// Refines a pose with Huber weights; returns the pose and the robust σ of its residuals.
fn refine_robust(corners: &[Corner], camera: &Camera, start: &Isometry3<f64>) -> Option<(Isometry3<f64>, f64)> {
    let mut pose = *start;
    for _ in 0..4 {
        let r = norms(corners, camera, &pose);
        let limit = 2.0 * sigma_of_norms(&r).max(SIGMA_FLOOR_PX);
        let weights: Vec<f64> = r.iter().map(|&r| huber(r, limit)).collect();
        pose = refine(corners, camera, &pose, &weights)?;
    }
    Some((pose, sigma_of_norms(&norms(corners, camera, &pose)).max(SIGMA_FLOOR_PX)))
}

/// Minimizes the weighted squared reprojection error over the six parameters of a pose.
pub(super) fn refine(
    corners: &[Corner],
    camera: &Camera,
    start: &Isometry3<f64>,
    weights: &[f64],
) -> Option<Isometry3<f64>> {
    let settings = LmSettings { damping: 1e-6, accept_equal: true, ..LmSettings::default() };
    let (normal, rhs) = (Matrix6::zeros(), Vector6::zeros());
    minimize(&mut Reprojection { corners, camera, weights, normal, rhs }, *start, &settings)
}

/// The reprojection error of one board; its parameters are a rotation, applied from the left, and a translation.
struct Reprojection<'a> {
    corners: &'a [Corner],
    camera: &'a Camera,
    weights: &'a [f64],
    normal: Matrix6<f64>,
    rhs: Vector6<f64>,
}

impl Problem for Reprojection<'_> {
    type Parameters = Isometry3<f64>;

    fn cost(&mut self, pose: &Isometry3<f64>) -> f64 {
        let r = norms(self.corners, self.camera, pose);
        r.iter().zip(self.weights).filter(|(_, w)| **w > 0.0).map(|(r, w)| w * r * r).sum()
    }

    fn linearize(&mut self, pose: &Isometry3<f64>, cost: f64) -> Option<f64> {
        let (mut a, mut g) = (Matrix6::zeros(), Vector6::zeros());
        for (c, &w) in self.corners.iter().zip(self.weights).filter(|(_, w)| **w > 0.0) {
            let arm = pose.rotation * Vector3::new(c.board_mm[0], c.board_mm[1], 0.0);
            let (px, j) = self.camera.project_with_jacobian(&(arm + pose.translation.vector).into())?;
            for k in 0..2 {
                let jp = Vector3::new(j[(k, 0)], j[(k, 1)], j[(k, 2)]);
                let by_turn = arm.cross(&jp);
                let row = Vector6::new(by_turn.x, by_turn.y, by_turn.z, jp.x, jp.y, jp.z);
                a += w * row * row.transpose();
                g += w * (c.px[k] - px[k]) * row;
            }
        }
        (self.normal, self.rhs) = (a, g);
        Some(cost)
    }

    fn step(&mut self, pose: &Isometry3<f64>, damping: f64) -> Option<Isometry3<f64>> {
        let mut m = self.normal;
        for i in 0..6 {
            m[(i, i)] *= 1.0 + damping;
        }
        Some(apply_step(pose, &m.cholesky()?.solve(&self.rhs)))
    }

    fn accept(&mut self, before: f64, after: f64) -> bool {
        before - after <= 1e-14 * before
    }
}

/// Returns a pose after a step: a rotation vector, applied from the left, and a shift (mm).
fn apply_step(pose: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
    let shift = pose.translation.vector + step.fixed_rows::<3>(3);
    Isometry3::from_parts(Translation3::from(shift), turn * pose.rotation)
}
