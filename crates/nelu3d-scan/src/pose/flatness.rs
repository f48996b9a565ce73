//! Is the board flat? Its bend, estimated together with the poses of a sweep.

use nalgebra::{Isometry3, Matrix6, SMatrix, SVector, Translation3, UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;

use super::bend::{Bend, Flatness, by_quadratic};
use super::pnp::{norms, solve_pnp};
use super::robust::{huber, sigma_of_norms};
use super::{PoseError, Trajectory, TrajectoryModel};
use crate::Camera;
use crate::board::Corner;

/// Parameters of the bend.
const BEND: usize = 3;
/// Parameters of the bend and of the lens.
const SHARED: usize = BEND + LENS.len();
/// By how much a camera's calibration is usually off, 1σ: focal length and principal point as fractions of the focal
/// length, and the first two radial coefficients. A bend looks much like them where boards hardly tilt, so that it may
/// only explain what they cannot.
const LENS: [f64; 5] = [0.003, 0.003, 0.003, 0.01, 0.05];
/// Smallest significance of a bend: its squared distance from flat in standard deviations. By chance 16 is passed once
/// in a thousand sweeps; corners' errors are not quite independent.
const SIGNIFICANT: f64 = 60.0;
/// Smallest fraction by which the bend that one half of the positions shows must lower the squared residuals of the
/// other. On a stage every position sees the same corners in nearly the same pixels, and misreads them alike: then all
/// positions together tell no more than one. Three parameters take 0.03 of what 48 such corners leave by chance, and 0.15
/// once in a hundred boards (F test).
const GAIN: f64 = 0.15;
/// No corner is better known than this, px.
const SIGMA_FLOOR_PX: f64 = 0.01;

impl Flatness {
    /// Solves for the poses of a sweep, as [`Trajectory::fit`] does, and for a bend of the board that all positions
    /// share. The bend is only taken into account where it is significant, errors of the camera's calibration
    /// considered, and where each half of the positions is explained better with the bend of the other. `extent_mm` is
    /// the board's outline.
    ///
    /// # Errors
    ///
    /// Those of [`Trajectory::fit`].
    pub fn fit(
        detections: &[(String, Result<Vec<Corner>, String>)],
        camera: &Camera,
        model: TrajectoryModel,
        extent_mm: [f64; 4],
    ) -> Result<Trajectory, PoseError> {
        let mut trajectory = Trajectory::fit(detections, camera, model)?;
        let views: Vec<View<'_>> =
            trajectory.positions.par_iter().filter_map(|p| View::of(&p.position, detections, camera)).collect();
        let Some(flatness) = Self::of_views(&views, camera, extent_mm) else { return Ok(trajectory) };
        if let Some(bend) = &flatness.bend {
            // Flattening depends on the pose through a small term only: each round gains two digits and more.
            for _ in 0..3 {
                let flattened: Vec<_> = detections.iter().map(|d| flattened(d, bend, camera, &trajectory)).collect();
                trajectory = Trajectory::fit(&flattened, camera, model)?;
            }
        }
        trajectory.flatness = Some(flatness);
        Ok(trajectory)
    }

    fn of_views(views: &[View<'_>], camera: &Camera, extent_mm: [f64; 4]) -> Option<Self> {
        let [x0, y0, x1, y1] = extent_mm;
        let center = [0.5 * (x0 + x1), 0.5 * (y0 + y1)];
        let all = Estimate::of(views, camera, center)?;
        let halves = [0, 1].map(|odd| -> Vec<View<'_>> {
            views.iter().enumerate().filter(|(i, _)| i % 2 == odd).map(|(_, v)| v.clone()).collect()
        });
        let gain = |from: &[View<'_>], to: &[View<'_>]| Some(Estimate::of(from, camera, center)?.gain(to, camera));
        let [even, odd] = &halves;
        let gain = gain(even, odd).zip(gain(odd, even)).map_or(0.0, |(a, b)| a.min(b));
        let significance = all.significance()?;
        let bend = Bend::from_quadratic(center, all.quadratic.into());
        let is_bent = significance > SIGNIFICANT && gain > GAIN;
        let sigma = |i: usize, length: f64| all.covariance[(i, i)].sqrt() * length * length / 4.0;
        Some(Self {
            bend: is_bent.then_some(bend),
            sagitta_mm: bend.sagittas_mm(extent_mm),
            sigma_mm: [sigma(0, x1 - x0), sigma(2, y1 - y0)],
            significance,
            gain,
        })
    }
}

/// A position's corners as they would be seen if the board were flat.
fn flattened(
    (name, found): &(String, Result<Vec<Corner>, String>),
    bend: &Bend,
    camera: &Camera,
    trajectory: &Trajectory,
) -> (String, Result<Vec<Corner>, String>) {
    let pose = trajectory.positions.iter().find(|p| p.position == *name).map(|p| p.cam_from_board);
    let found = match (found, pose) {
        (Ok(corners), Some(pose)) => Ok(bend.flattened(corners, camera, &pose)),
        (found, _) => found.clone(),
    };
    (name.clone(), found)
}

/// The corners of a position, and its free pose.
#[derive(Clone)]
struct View<'a> {
    corners: &'a [Corner],
    pose: Isometry3<f64>,
}

impl<'a> View<'a> {
    fn of(name: &str, detections: &'a [(String, Result<Vec<Corner>, String>)], camera: &Camera) -> Option<Self> {
        let corners = detections.iter().find(|d| d.0 == name)?.1.as_ref().ok()?;
        let pose = solve_pnp(corners, camera).ok()?.cam_from_board;
        Some(Self { corners, pose })
    }
}

/// A bend, estimated together with the poses and with what the camera's calibration leaves open.
struct Estimate {
    center: [f64; 2],
    /// Coefficients of [`Bend::from_quadratic`], 1/mm.
    quadratic: SVector<f64, BEND>,
    covariance: SMatrix<f64, BEND, BEND>,
}

/// Normal equations of one view: its pose, and its part of what all views share.
struct Block {
    pose: Matrix6<f64>,
    cross: SMatrix<f64, 6, SHARED>,
    pose_rhs: Vector6<f64>,
}

impl Estimate {
    /// Minimizes the robust reprojection error by Gauss–Newton steps; `None` where the boards do not determine it.
    fn of(views: &[View<'_>], camera: &Camera, center: [f64; 2]) -> Option<Self> {
        if views.is_empty() {
            return None;
        }
        let mut poses: Vec<Isometry3<f64>> = views.iter().map(|v| v.pose).collect();
        let mut shared = SVector::<f64, SHARED>::zeros();
        let mut system = SMatrix::<f64, SHARED, SHARED>::zeros();
        for _ in 0..12 {
            let bend = Bend::from_quadratic(center, [shared[0], shared[1], shared[2]]);
            let residuals: Vec<Vec<Residual>> = views
                .iter()
                .zip(&poses)
                .map(|(v, pose)| residuals(v.corners, camera, pose, &bend, &shared))
                .collect::<Option<_>>()?;
            let norms: Vec<f64> = residuals.iter().flatten().map(Residual::norm).collect();
            let sigma = sigma_of_norms(&norms).max(SIGMA_FLOOR_PX);
            system.fill(0.0);
            let mut rhs = SVector::<f64, SHARED>::zeros();
            for (i, prior) in LENS.iter().enumerate() {
                let weight = 1.0 / (prior * prior);
                system[(BEND + i, BEND + i)] += weight;
                rhs[BEND + i] -= weight * shared[BEND + i];
            }
            let mut blocks = Vec::with_capacity(views.len());
            for residuals in &residuals {
                let mut block = Block { pose: Matrix6::zeros(), cross: SMatrix::zeros(), pose_rhs: Vector6::zeros() };
                for r in residuals {
                    let weight = huber(r.norm(), 2.0 * sigma) / (sigma * sigma);
                    for ((e, by_pose), by_shared) in r.px.iter().zip(&r.by_pose).zip(&r.by_shared) {
                        block.pose += weight * by_pose * by_pose.transpose();
                        block.cross += weight * by_pose * by_shared.transpose();
                        block.pose_rhs += weight * *e * by_pose;
                        system += weight * by_shared * by_shared.transpose();
                        rhs += weight * *e * by_shared;
                    }
                }
                // Schur's complement: what the poses leave open.
                let solved = block.pose.cholesky()?;
                system -= block.cross.transpose() * solved.solve(&block.cross);
                rhs -= block.cross.transpose() * solved.solve(&block.pose_rhs);
                blocks.push(block);
            }
            let step = system.cholesky()?.solve(&rhs);
            shared += step;
            for (pose, block) in poses.iter_mut().zip(&blocks) {
                let own = block.pose.cholesky()?.solve(&(block.pose_rhs - block.cross * step));
                let turn = UnitQuaternion::from_scaled_axis(own.fixed_rows::<3>(0).into_owned());
                let shift = pose.translation.vector + own.fixed_rows::<3>(3);
                *pose = Isometry3::from_parts(Translation3::from(shift), turn * pose.rotation);
            }
        }
        let covariance = system.try_inverse()?.fixed_view::<BEND, BEND>(0, 0).into_owned();
        let quadratic = shared.fixed_rows::<BEND>(0).into_owned();
        quadratic.iter().all(|v| v.is_finite()).then_some(Self { center, quadratic, covariance })
    }

    /// Returns the squared distance from flat, in standard deviations.
    fn significance(&self) -> Option<f64> {
        Some(self.quadratic.dot(&self.covariance.cholesky()?.solve(&self.quadratic)))
    }

    /// Returns the fraction of the squared residuals of some views that goes away with this bend.
    fn gain(&self, views: &[View<'_>], camera: &Camera) -> f64 {
        let bend = Bend::from_quadratic(self.center, self.quadratic.into());
        let (mut flat, mut bent) = (0.0, 0.0);
        for view in views {
            let Some(of_flat) = squares(view.corners, camera) else { continue };
            let Some(of_bent) = squares(&bend.flattened(view.corners, camera, &view.pose), camera) else { continue };
            // Corners misread are misread in both.
            let limit = 9.0 * sigma_of_squares(&of_flat).max(SIGMA_FLOOR_PX.powi(2));
            let sum = |s: &[f64]| s.iter().map(|s| s.min(limit)).sum::<f64>();
            (flat, bent) = (flat + sum(&of_flat), bent + sum(&of_bent));
        }
        if flat > 0.0 { 1.0 - bent / flat } else { 0.0 }
    }
}

/// Returns the squared residuals of corners in their best pose, px².
fn squares(corners: &[Corner], camera: &Camera) -> Option<Vec<f64>> {
    let pose = solve_pnp(corners, camera).ok()?.cam_from_board;
    Some(norms(corners, camera, &pose).iter().map(|r| r * r).collect())
}

/// Returns the robust variance of one coordinate from squared norms.
fn sigma_of_squares(squares: &[f64]) -> f64 {
    sigma_of_norms(&squares.iter().map(|s| s.sqrt()).collect::<Vec<_>>()).powi(2)
}

/// How far a corner is from where it should be, px, and the derivatives of where it should be.
struct Residual {
    px: [f64; 2],
    /// By a rotation vector, applied from the left, and a shift (mm).
    by_pose: [Vector6<f64>; 2],
    /// By the bend's coefficients and the lens.
    by_shared: [SVector<f64, SHARED>; 2],
}

impl Residual {
    fn norm(&self) -> f64 {
        self.px[0].hypot(self.px[1])
    }
}

fn residuals(
    corners: &[Corner],
    camera: &Camera,
    pose: &Isometry3<f64>,
    bend: &Bend,
    shared: &SVector<f64, SHARED>,
) -> Option<Vec<Residual>> {
    let one = |c: &Corner| {
        let arm = pose.rotation * bend.point(c.board_mm).coords;
        let point = arm + pose.translation.vector;
        let (px, j) = camera.project_with_jacobian(&point.into())?;
        let by_bend = by_quadratic(bend.center_mm, c.board_mm).map(|d| pose.rotation * d);
        let ray = [point.x / point.z, point.y / point.z];
        let r2 = ray[0] * ray[0] + ray[1] * ray[1];
        let mut out = Residual { px: [0.0; 2], by_pose: [Vector6::zeros(); 2], by_shared: [SVector::zeros(); 2] };
        for (k, f) in [camera.fx, camera.fy].into_iter().enumerate() {
            let jp = Vector3::new(j[(k, 0)], j[(k, 1)], j[(k, 2)]);
            let by_turn = arm.cross(&jp);
            out.by_pose[k] = Vector6::new(by_turn.x, by_turn.y, by_turn.z, jp.x, jp.y, jp.z);
            let row = &mut out.by_shared[k];
            by_bend.iter().enumerate().for_each(|(i, d)| row[i] = jp.dot(d));
            row[BEND] = f * ray[k];
            row[BEND + 1 + k] = f;
            row[BEND + 3] = f * ray[k] * r2;
            row[BEND + 4] = f * ray[k] * r2 * r2;
            let lens: f64 = (BEND..SHARED).map(|i| row[i] * shared[i]).sum();
            out.px[k] = c.px[k] - px[k] - lens;
        }
        Some(out)
    };
    corners.iter().map(one).collect()
}
