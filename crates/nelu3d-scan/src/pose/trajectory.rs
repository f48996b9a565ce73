//! The board poses of a whole sweep.

use nalgebra::Isometry3;
use rayon::prelude::*;
use serde::{Serialize, Serializer};

use super::pnp::norms;
use super::robust::median;
use super::stage::Stage;
use super::{Bend, Flatness, PoseError, PoseFit, solve_pnp};
use crate::Camera;
use crate::board::Corner;
use crate::rig::KnownPose;

/// How the board moved between positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrajectoryModel {
    /// `Stage` if it explains the corners as well as `Free` does, within noise; else `Free`.
    Auto,
    /// Every pose on its own: boards held by hand.
    Free,
    /// One rotation, positions on one line, any steps between them.
    Stage,
    /// One rotation, positions on one line, the same step between any two neighbors of the list. Positions without a
    /// detection get a pose, too.
    StageEqualSteps,
}

/// The board poses of a sweep, with what they were fitted to.
#[derive(Clone, Debug, Serialize)]
pub struct Trajectory {
    /// The model used: `free`, `stage`, `stage-equal-steps` or `known`.
    pub model: &'static str,
    /// Why this model.
    pub reason: String,
    /// Root mean square reprojection error over all corners used, px; absent when the poses were known beforehand.
    pub rms_px: Option<f64>,
    /// Root mean square reprojection error with every pose on its own, px.
    pub rms_free_px: Option<f64>,
    /// Root mean square reprojection error with one rotation and one line, over the same corners, px.
    pub rms_stage_px: Option<f64>,
    /// Steps of the stage, when it was fitted.
    pub steps: Option<Steps>,
    /// What the sweep tells of the board's flatness; absent where that was not asked for or cannot be told.
    pub flatness: Option<Flatness>,
    /// Usable positions, in the sweep's order.
    pub positions: Vec<Position>,
    /// The others.
    pub rejected: Vec<Rejected>,
}

/// The steps of a stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Steps {
    /// Unit direction of travel in the camera's frame.
    pub direction: [f64; 3],
    /// Mean step between neighbors of the sweep's list, mm.
    pub mean_mm: f64,
    /// Root mean square deviation of positions from equal steps, mm.
    pub deviation_mm: f64,
}

/// A usable board position.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Position {
    /// Name of the position's folder.
    pub position: String,
    /// Takes board coordinates to camera coordinates, mm. Serialized as a Rodrigues vector and a translation.
    #[serde(serialize_with = "serialize_pose")]
    pub cam_from_board: Isometry3<f64>,
    /// Root mean square reprojection error, px; absent when no corner of this position was used.
    pub rms_px: Option<f64>,
    /// Corners used.
    pub n_corners: usize,
    /// Corners rejected as outliers.
    pub n_rejected: usize,
}

/// A position that is not usable.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Rejected {
    /// Name of the position's folder.
    pub position: String,
    /// Why.
    pub reason: String,
}

fn serialize_pose<S: Serializer>(pose: &Isometry3<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Pose {
        rotation: [f64; 3],
        translation: [f64; 3],
    }
    let (rotation, translation) = (pose.rotation.scaled_axis().into(), pose.translation.vector.into());
    Pose { rotation, translation }.serialize(serializer)
}

/// A position with a free pose.
struct View {
    /// Place in the sweep's list.
    number: usize,
    name: String,
    /// The corners that the free pose uses.
    corners: Vec<Corner>,
    fit: PoseFit,
}

impl Trajectory {
    /// Returns the bend of the board that its poses are those of, if it is not flat.
    pub fn bend(&self) -> Option<&Bend> {
        self.flatness.as_ref()?.bend.as_ref()
    }

    /// Solves for the poses of a sweep from what was detected at each position, in the sweep's order. Positions without
    /// a detection, or whose corners fit no pose, are rejected with a reason; fewer than 3 usable ones are an error.
    pub fn fit(
        detections: &[(String, Result<Vec<Corner>, String>)],
        camera: &Camera,
        model: TrajectoryModel,
    ) -> Result<Self, PoseError> {
        let mut rejected = Vec::new();
        let mut views = free_views(detections, camera, &mut rejected);
        let few = |usable: usize, rejected: &[Rejected]| PoseError::TooFewPositions {
            usable,
            total: detections.len(),
            reasons: rejected.iter().map(|r| (r.position.clone(), r.reason.clone())).collect(),
        };
        if views.len() < 3 {
            return Err(few(views.len(), &rejected));
        }
        if model == TrajectoryModel::Free {
            return Ok(Self::free(&views, rejected, "asked for".into(), None));
        }
        let equal = model == TrajectoryModel::StageEqualSteps;
        let stage = fit_stage(&views, camera, equal);
        if model == TrajectoryModel::Auto {
            let free = sum_of_squares(&views, camera, |i| views[i].fit.cam_from_board);
            let Some(stage) = stage else {
                return Ok(Self::free(&views, rejected, "no stage fits".into(), None));
            };
            let line = sum_of_squares(&views, camera, |i| stage.pose(i));
            let verdict = Verdict::new(&views, free, line);
            if !verdict.stage {
                return Ok(Self::free(&views, rejected, verdict.reason, Some(verdict.rms_stage_px)));
            }
            return Ok(Self::stage(&views, camera, &stage, rejected, verdict.reason, detections));
        }
        // Asked to believe in the stage: a position that contradicts it was bumped or misread, the others are kept.
        let mut stage = stage.ok_or_else(|| few(0, &rejected))?;
        loop {
            let rms: Vec<f64> =
                (0..views.len()).map(|i| rms(&norms(&views[i].corners, camera, &stage.pose(i)))).collect();
            let limit = 5.0 * median(&rms);
            let (worst, &largest) =
                rms.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).expect("views are not empty");
            if largest <= limit.max(0.02) || views.len() <= 3 {
                break;
            }
            let view = views.remove(worst);
            rejected.push(Rejected {
                position: view.name,
                reason: format!(
                    "it is not where the stage would have put it: {largest:.3} px off, the others {:.3} px",
                    median(&rms)
                ),
            });
            stage = fit_stage(&views, camera, equal).ok_or_else(|| few(0, &rejected))?;
        }
        sort_as(detections, &mut rejected);
        Ok(Self::stage(&views, camera, &stage, rejected, "asked for".into(), detections))
    }

    /// Takes over poses that are known without detecting the board. Fewer than 3 are an error.
    pub fn from_known(poses: &[KnownPose]) -> Result<Self, PoseError> {
        if poses.len() < 3 {
            return Err(PoseError::TooFewPositions { usable: poses.len(), total: poses.len(), reasons: Vec::new() });
        }
        let position = |p: &KnownPose| Position {
            position: p.position.clone(),
            cam_from_board: p.cam_from_board,
            rms_px: None,
            n_corners: 0,
            n_rejected: 0,
        };
        Ok(Self {
            model: "known",
            reason: "rig.toml says where the board was".into(),
            rms_px: None,
            rms_free_px: None,
            rms_stage_px: None,
            steps: None,
            flatness: None,
            positions: poses.iter().map(position).collect(),
            rejected: Vec::new(),
        })
    }

    fn free(views: &[View], rejected: Vec<Rejected>, reason: String, rms_stage_px: Option<f64>) -> Self {
        let position = |v: &View| Position {
            position: v.name.clone(),
            cam_from_board: v.fit.cam_from_board,
            rms_px: Some(v.fit.rms_px),
            n_corners: v.fit.n_corners,
            n_rejected: v.fit.n_rejected,
        };
        let rms_free_px = Some(pooled_free(views));
        Self {
            model: "free",
            reason,
            rms_px: rms_free_px,
            rms_free_px,
            rms_stage_px,
            steps: None,
            flatness: None,
            positions: views.iter().map(position).collect(),
            rejected,
        }
    }

    fn stage(
        views: &[View],
        camera: &Camera,
        stage: &Stage,
        rejected: Vec<Rejected>,
        reason: String,
        detections: &[(String, Result<Vec<Corner>, String>)],
    ) -> Self {
        let mut positions: Vec<(usize, Position)> = Vec::new();
        for (i, v) in views.iter().enumerate() {
            let cam_from_board = stage.pose(i);
            let rms_px = Some(rms(&norms(&v.corners, camera, &cam_from_board)));
            let (n_corners, n_rejected) = (v.corners.len(), v.fit.n_rejected);
            positions
                .push((v.number, Position { position: v.name.clone(), cam_from_board, rms_px, n_corners, n_rejected }));
        }
        let mut rejected = rejected;
        if stage.equal_steps {
            // The model says where the others are; those that contradict it were detected, and stay out.
            rejected.retain(|r| {
                let number = detections.iter().position(|d| d.0 == r.position && d.1.is_err());
                let Some(number) = number else { return true };
                let cam_from_board = stage.pose_at(number as f64);
                let position = Position {
                    position: r.position.clone(),
                    cam_from_board,
                    rms_px: None,
                    n_corners: 0,
                    n_rejected: 0,
                };
                positions.push((number, position));
                false
            });
            positions.sort_by_key(|p| p.0);
        }
        let squares = sum_of_squares(views, camera, |i| stage.pose(i));
        let rms_stage_px = Some((squares / n_corners(views) as f64).sqrt());
        Self {
            model: if stage.equal_steps { "stage-equal-steps" } else { "stage" },
            reason,
            rms_px: rms_stage_px,
            rms_free_px: Some(pooled_free(views)),
            rms_stage_px,
            steps: Some(steps(views, stage)),
            flatness: None,
            positions: positions.into_iter().map(|p| p.1).collect(),
            rejected,
        }
    }
}

/// Solves each position on its own; what cannot be used goes to `rejected`.
fn free_views(
    detections: &[(String, Result<Vec<Corner>, String>)],
    camera: &Camera,
    rejected: &mut Vec<Rejected>,
) -> Vec<View> {
    let solve = |(_, found): &(String, Result<Vec<Corner>, String>)| match found {
        Ok(corners) => solve_pnp(corners, camera).map_err(|e| e.to_string()),
        Err(reason) => Err(reason.clone()),
    };
    let solved: Vec<Result<PoseFit, String>> = detections.par_iter().map(solve).collect();
    let mut views = Vec::new();
    for (number, ((name, found), solved)) in detections.iter().zip(solved).enumerate() {
        match found.as_ref().map_err(Clone::clone).and_then(|corners| Ok((corners, solved?))) {
            Ok((corners, fit)) => {
                let corners = corners.iter().zip(&fit.used).filter(|(_, u)| **u).map(|(c, _)| *c).collect();
                views.push(View { number, name: name.clone(), corners, fit });
            }
            Err(reason) => rejected.push(Rejected { position: name.clone(), reason }),
        }
    }
    let typical = median(&views.iter().map(|v| v.fit.rms_px).collect::<Vec<_>>());
    views.retain(|v| {
        // A board read wrongly (another print, a mirror image) fits no pose at all.
        let bad = v.fit.rms_px > (8.0 * typical).max(0.5) || v.fit.n_rejected > v.fit.n_corners;
        if bad {
            let (rms, n, all) = (v.fit.rms_px, v.fit.n_rejected, v.fit.n_rejected + v.fit.n_corners);
            let reason =
                format!("its corners fit no pose: {rms:.2} px off ({typical:.2} elsewhere), {n} of {all} are outliers");
            rejected.push(Rejected { position: v.name.clone(), reason });
        }
        !bad
    });
    sort_as(detections, rejected);
    views
}

fn sort_as(detections: &[(String, Result<Vec<Corner>, String>)], rejected: &mut [Rejected]) {
    rejected.sort_by_key(|r| detections.iter().position(|d| d.0 == r.position));
}

fn fit_stage(views: &[View], camera: &Camera, equal: bool) -> Option<Stage> {
    let corners: Vec<&[Corner]> = views.iter().map(|v| v.corners.as_slice()).collect();
    let poses: Vec<Isometry3<f64>> = views.iter().map(|v| v.fit.cam_from_board).collect();
    let numbers: Vec<f64> = views.iter().map(|v| v.number as f64).collect();
    Stage::fit(&corners, camera, &poses, equal.then_some(numbers.as_slice()))
}

/// Which model explains the corners: the Bayesian information criterion on the residuals.
struct Verdict {
    stage: bool,
    reason: String,
    rms_stage_px: f64,
}

impl Verdict {
    /// Compares the sums of squares of both fits, px².
    ///
    /// BIC = N ln(S/N) + k ln N (Schwarz 1978), N coordinates, k parameters: 6 a position, or 8 and one more for each
    /// position but the first. Unlike an F test it does not turn down a stage for deviations that are real but tiny
    /// against the corners' own errors.
    fn new(views: &[View], free: f64, stage: f64) -> Self {
        let corners = n_corners(views) as f64;
        let (n, p) = (2.0 * corners, views.len() as f64);
        // Below a thousandth of a pixel differences mean nothing.
        let floor = corners * 1e-6;
        let bic = |s: f64, k: f64| n * ((s + floor) / n).ln() + k * n.ln();
        let (a, b) = (bic(free, 6.0 * p), bic(stage, 7.0 + p));
        let (rms_free_px, rms_stage_px) = ((free / corners).sqrt(), (stage / corners).sqrt());
        let verdict = if b <= a { "as well as" } else { "worse than" };
        let reason = format!(
            "one rotation and one line explain the corners {verdict} free poses do: {rms_stage_px:.4} px against \
             {rms_free_px:.4} px (BIC {b:.0} against {a:.0})"
        );
        Self { stage: b <= a, reason, rms_stage_px }
    }
}

fn n_corners(views: &[View]) -> usize {
    views.iter().map(|v| v.corners.len()).sum()
}

fn sum_of_squares(views: &[View], camera: &Camera, pose: impl Fn(usize) -> Isometry3<f64>) -> f64 {
    let of = |i: usize| -> f64 { norms(&views[i].corners, camera, &pose(i)).iter().map(|r| r * r).sum() };
    (0..views.len()).map(of).sum()
}

fn pooled_free(views: &[View]) -> f64 {
    let s: f64 = views.iter().map(|v| v.fit.rms_px.powi(2) * v.fit.n_corners as f64).sum();
    (s / n_corners(views) as f64).sqrt()
}

fn rms(norms: &[f64]) -> f64 {
    (norms.iter().map(|r| r * r).sum::<f64>() / norms.len().max(1) as f64).sqrt()
}

/// Returns the steps of the stage: a regression of the distances on the places in the list.
fn steps(views: &[View], stage: &Stage) -> Steps {
    let length = stage.dir.norm();
    let direction = (stage.dir / length).into();
    let n = views.len() as f64;
    let s: Vec<f64> = stage.s.iter().map(|s| s * length).collect();
    let (x, y) = (views.iter().map(|v| v.number as f64).sum::<f64>() / n, s.iter().sum::<f64>() / n);
    let dx = |v: &View| v.number as f64 - x;
    let mean_mm = views.iter().zip(&s).map(|(v, s)| dx(v) * (s - y)).sum::<f64>()
        / views.iter().map(|v| dx(v).powi(2)).sum::<f64>();
    let deviations: Vec<f64> = views.iter().zip(&s).map(|(v, s)| s - y - mean_mm * dx(v)).collect();
    Steps { direction, mean_mm, deviation_mm: rms(&deviations) }
}
