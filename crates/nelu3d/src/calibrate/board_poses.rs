//! The poses of a sweep's boards, and the dark level.

use nalgebra::Isometry3;
use nelu3d_scan::Rig;
use nelu3d_scan::board::{Corner, Detector};
use nelu3d_scan::pose::{Flatness, Trajectory, TrajectoryModel};
use nelu3d_scan::rig::PatternSet;

use super::error::CalibrationError;
use super::options::{CalibrationOptions, TrajectoryKind};
use super::placed_sweep::PlacedSweep;
use super::sweep::Sweep;
use crate::progress::{Progress, StageClock};
use crate::sensor::{DarkEstimator, DarkLevel};

/// A sweep with the poses of its boards.
pub struct SweepGeometry<'a> {
    /// Positions that have a pose.
    pub placed: PlacedSweep<'a>,
    /// Poses, and the positions that were rejected.
    pub trajectory: Trajectory,
    /// Dark level per channel.
    pub dark: Vec<DarkLevel>,
}

/// Detects the boards of a sweep and solves their poses, and their bend if they are not flat; on the way the dark level is estimated. Positions without a
/// pose are dropped with a warning.
///
/// # Errors
///
/// The board is not described or cannot be detected, an image cannot be read, or fewer than 3 positions have a pose.
pub fn solve_board_poses<'a>(
    rig: &'a Rig,
    set: &'a PatternSet,
    opts: &CalibrationOptions,
    progress: &Progress,
    clock: &mut StageClock<'_>,
) -> Result<SweepGeometry<'a>, CalibrationError> {
    let rig_file = rig.root.join(nelu3d_scan::rig::RIG_FILE);
    let board = rig.board.as_ref().ok_or_else(|| CalibrationError::NoBoard(rig_file.clone()))?;
    let detector = Detector::new(board)
        .map_err(|source| CalibrationError::Board { path: rig_file, source })?
        .with_camera(&rig.camera);
    let mut shots = rig.positions()?;
    let folder = rig.root.join("calibration");
    for name in &opts.leave_out {
        let before = shots.len();
        shots.retain(|s| s.name != *name);
        if shots.len() == before {
            let known = shots.iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(", ");
            return Err(CalibrationError::NoPosition { path: folder, name: name.clone(), known });
        }
    }
    if shots.len() < 3 {
        return Err(CalibrationError::TooFew { path: folder, found: shots.len(), reasons: String::new() });
    }

    clock.begin("find the boards");
    let mut sweep = Sweep::new(rig, set, shots, opts.min_contrast);
    let (found, dark) = find_boards(&sweep, &detector, opts, progress)?;

    clock.begin("solve the board poses");
    let trajectory = if rig.poses.is_empty() {
        let model = match opts.trajectory {
            TrajectoryKind::Auto => TrajectoryModel::Auto,
            TrajectoryKind::Free => TrajectoryModel::Free,
            TrajectoryKind::Stage => TrajectoryModel::Stage,
        };
        Flatness::fit(&found, &rig.camera, model, board.extent_mm)
    } else {
        Trajectory::from_known(&rig.poses)
    };
    let trajectory = trajectory.map_err(|source| CalibrationError::Pose { path: folder.clone(), source })?;
    for r in &trajectory.rejected {
        progress.warn(format!("board position {} is not used: {}", r.position, r.reason));
    }
    let poses = retain_posed(&mut sweep, &trajectory);
    if poses.len() < 3 {
        let reasons = trajectory.rejected.iter().map(|r| format!("; {}: {}", r.position, r.reason)).collect();
        return Err(CalibrationError::TooFew { path: folder, found: poses.len(), reasons });
    }
    if progress.cancelled() {
        return Err(CalibrationError::Cancelled);
    }
    let placed = PlacedSweep::new(sweep, &poses, rig.camera.clone(), board.extent_mm, trajectory.bend().copied());
    Ok(SweepGeometry { placed, trajectory, dark })
}

/// The detected corners of each position, or why there are none.
type DetectedCorners = Vec<(String, Result<Vec<Corner>, String>)>;

/// Detects the board in every white image, and estimates the dark level.
fn find_boards(
    sweep: &Sweep<'_>,
    detector: &Detector,
    opts: &CalibrationOptions,
    progress: &Progress,
) -> Result<(DetectedCorners, Vec<DarkLevel>), CalibrationError> {
    let parts = sweep.map_white_black(progress, |shot, white, black| {
        let corners = detector.detect(&white.to_gray(), white.width, white.height).map_err(|e| e.to_string());
        let mut dark = DarkEstimator::default();
        dark.add(white, black, opts.min_contrast);
        ((shot.name.clone(), corners), dark)
    })?;
    let mut all = DarkEstimator::default();
    let mut found = DetectedCorners::with_capacity(parts.len());
    for (corners, dark) in parts {
        all.merge(&dark);
        found.push(corners);
    }
    Ok((found, all.finish()))
}

/// Retains the positions that have a pose; returns their poses, in order.
fn retain_posed(sweep: &mut Sweep<'_>, trajectory: &Trajectory) -> Vec<Isometry3<f64>> {
    let pose_of = |name: &str| trajectory.positions.iter().find(|p| p.position == name).map(|p| p.cam_from_board);
    sweep.retain(|name| pose_of(name).is_some());
    sweep.shots.iter().filter_map(|s| pose_of(&s.name)).collect()
}
