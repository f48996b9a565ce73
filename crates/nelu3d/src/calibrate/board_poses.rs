//! The poses of a sweep's boards, and the dark level.

use nalgebra::Isometry3;
use nelu3d_scan::board::{Corner, Detector};
use nelu3d_scan::pose::{
    Bend, Flatness, SharedCause, SharedMisfit, Trajectory, TrajectoryModel, explain_misfit, solve_pnp,
};
use nelu3d_scan::rig::PatternSet;
use nelu3d_scan::statistics::median;
use nelu3d_scan::{Camera, Image, Rig};
use rayon::prelude::*;

use super::error::CalibrationError;
use super::options::{CalibrationOptions, TrajectoryKind};
use super::placed_sweep::PlacedSweep;
use super::sweep::Sweep;
use crate::color_field::BoardPlace;
use crate::progress::{Progress, StageClock};
use crate::sensor::{BlockDetector, Blur, DarkEstimator, DarkLevel};

/// A sweep with the poses of its boards.
pub struct SweepGeometry<'a> {
    /// Positions that have a pose.
    pub placed: PlacedSweep<'a>,
    /// Poses, and the positions that were rejected.
    pub trajectory: Trajectory,
    /// Dark level per channel.
    pub dark: Vec<DarkLevel>,
    /// What corners and white images tell of the set-up.
    pub facts: SweepFacts,
}

/// What corners and white images tell of the set-up.
pub struct SweepFacts {
    /// The corners' misfit, and what could explain it.
    pub misfit: Option<SharedMisfit>,
    /// Fraction of the lit pixels of the white images that are clipped.
    pub clipped: f64,
    /// Traces of lossy compression.
    pub blocks: BlockDetector,
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
    let Boards { found, blur, dark, whites } = find_boards(&sweep, &detector, opts, progress)?;

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
    let placed = PlacedSweep::new(sweep, &poses, board, trajectory.bend().copied(), blur);
    let misfit = shared_misfit(&found, &trajectory, &rig.camera);
    let facts = SweepFacts { misfit, clipped: whites.clipped_share(), blocks: whites.blocks };
    Ok(SweepGeometry { placed, trajectory, dark, facts })
}

/// The detected corners of each position, or why there are none.
type DetectedCorners = Vec<(String, Result<Vec<Corner>, String>)>;

/// What white and black images of the sweep show.
struct Boards {
    found: DetectedCorners,
    /// Blur of the sensor's pixels.
    blur: Blur,
    /// Dark level per channel.
    dark: Vec<DarkLevel>,
    whites: WhiteImages,
}

/// Blur of the camera beyond a pixel's own area where no board was found (all poses are known then), px: that of a sharp
/// lens.
const TYPICAL_BLUR_PX: f64 = 0.4;

/// Detects the board in every white image, and estimates the dark level and the blur of the camera: the median over
/// positions of what edges of the board show.
fn find_boards(
    sweep: &Sweep<'_>,
    detector: &Detector,
    opts: &CalibrationOptions,
    progress: &Progress,
) -> Result<Boards, CalibrationError> {
    let parts = sweep.map_white_black(progress, |shot, white, black| {
        let sighting = detector.sight(&white.to_gray(), white.width, white.height).map_err(|e| e.to_string());
        let mut dark = DarkEstimator::default();
        dark.add(white, black, opts.min_contrast);
        ((shot.name.clone(), sighting), dark, WhiteImages::of(white, black, opts.min_contrast))
    })?;
    let mut all = DarkEstimator::default();
    let mut found = DetectedCorners::with_capacity(parts.len());
    let (mut whites, mut blurs) = (WhiteImages::default(), Vec::with_capacity(parts.len()));
    for ((name, sighting), dark, white) in parts {
        all.merge(&dark);
        whites.merge(&white);
        blurs.extend(sighting.as_ref().ok().map(|sighting| sighting.blur_px));
        found.push((name, sighting.map(|sighting| sighting.corners)));
    }
    let blur = Blur::of_optics(median(&mut blurs).unwrap_or(TYPICAL_BLUR_PX) as f32);
    tracing::debug!(?blur, "blur of the camera, square pixels");
    Ok(Boards { found, blur, dark: all.finish(), whites })
}

/// Counts over the white images of a sweep.
#[derive(Default)]
struct WhiteImages {
    /// Pixels that the light source lights, and those of them that are clipped.
    lit: usize,
    clipped: usize,
    blocks: BlockDetector,
}

impl WhiteImages {
    fn of(white: &Image, black: &Image, min_contrast: f32) -> Self {
        let mut out = Self::default();
        for (w, b) in white.data.iter().zip(&black.data) {
            out.lit += usize::from(w - b >= min_contrast);
            out.clipped += usize::from(w - b >= min_contrast && *w >= 1.0);
        }
        out.blocks.add(white);
        out
    }

    fn merge(&mut self, other: &Self) {
        self.lit += other.lit;
        self.clipped += other.clipped;
        self.blocks.merge(&other.blocks);
    }

    fn clipped_share(&self) -> f64 {
        self.clipped as f64 / self.lit.max(1) as f64
    }
}

/// Asks what explains the misfit of the corners of the positions that are used, each with a pose of its own. Of a bend
/// that is taken into account, the rest: unless something else explains the corners better than a bend does.
fn shared_misfit(found: &DetectedCorners, trajectory: &Trajectory, camera: &Camera) -> Option<SharedMisfit> {
    let flat = misfit_of(found, trajectory, camera, None)?;
    let Some(bend) = trajectory.bend() else { return Some(flat) };
    if flat.likeliest(|_| true).is_some_and(|e| e.cause != SharedCause::Bend) {
        return Some(flat);
    }
    let mut rest = misfit_of(found, trajectory, camera, Some(bend))?;
    rest.causes.retain(|e| e.cause != SharedCause::Bend);
    Some(rest)
}

/// Asks what explains the misfit of corners, beyond a bend of the board.
fn misfit_of(
    found: &DetectedCorners,
    trajectory: &Trajectory,
    camera: &Camera,
    bend: Option<&Bend>,
) -> Option<SharedMisfit> {
    let is_used = |name: &str| trajectory.positions.iter().any(|p| p.position == name);
    let view = |(_, corners): &(String, Result<Vec<Corner>, String>)| {
        let mut corners = corners.as_ref().ok()?.clone();
        let mut fit = solve_pnp(&corners, camera).ok()?;
        if let Some(bend) = bend {
            corners = bend.flattened(&corners, camera, &fit.cam_from_board);
            fit = solve_pnp(&corners, camera).ok()?;
        }
        let used: Vec<Corner> = corners.iter().zip(&fit.used).filter(|(_, used)| **used).map(|(c, _)| *c).collect();
        Some((used, fit.cam_from_board))
    };
    let views: Vec<_> = found.par_iter().filter(|(name, _)| is_used(name)).filter_map(view).collect();
    let views: Vec<_> = views.iter().map(|(corners, pose)| (corners.as_slice(), *pose)).collect();
    explain_misfit(&views, camera)
}

/// Retains the positions that have a pose; returns their poses, in order.
fn retain_posed(sweep: &mut Sweep<'_>, trajectory: &Trajectory) -> Vec<Isometry3<f64>> {
    let pose_of = |name: &str| trajectory.positions.iter().find(|p| p.position == name).map(|p| p.cam_from_board);
    sweep.retain(|name| pose_of(name).is_some());
    sweep.shots.iter().filter_map(|s| pose_of(&s.name)).collect()
}

/// Returns where the boards of the positions that are used stand.
pub(super) fn places(trajectory: &Trajectory, placed: &PlacedSweep<'_>) -> Vec<BoardPlace> {
    let is_used = |name: &str| placed.sweep.shots.iter().any(|s| s.name == name);
    let used = trajectory.positions.iter().filter(|p| is_used(&p.position));
    used.map(|p| BoardPlace::new(&p.position, &p.cam_from_board)).collect()
}
