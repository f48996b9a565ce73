//! From the sweep of a rig to its projector.

use std::path::Path;

use nalgebra::{Isometry3, Point3};
use nelu3d::progress::{Progress, StageClock};
use nelu3d_scan::board::{Corner, Detector};
use nelu3d_scan::pose::{Flatness, Trajectory, TrajectoryModel};
use nelu3d_scan::rig::{PatternSet, RIG_FILE, Shot};
use nelu3d_scan::{Projector, Rig};

use super::coded_set::coded_set;
use super::error::ProjectorError;
use super::measure_response::measure_response;
use super::options::ProjectorOptions;
use super::report::ProjectorReport;
use super::sample::Sample;
use super::{corners, fit};
use crate::captured::{Captured, Images};
use crate::code::Code;

/// Fewest corners that determine a projector with some certainty.
const MIN_CORNERS: usize = 24;

/// Calibrates the projector of a rig. `set` is a binary code along x and y; without one, the first that is.
///
/// # Errors
///
/// The rig has no board, no sweep, no set with a binary code along both axes, or too few positions or corners; or the
/// corners do not determine a projector.
pub fn calibrate_projector(
    rig: &Rig,
    set: Option<&str>,
    opts: &ProjectorOptions,
    progress: &Progress,
) -> Result<(Projector, ProjectorReport), ProjectorError> {
    let mut clock = StageClock::new(progress);
    clock.begin("read the projected patterns");
    let rig_file = rig.root.join(RIG_FILE);
    let board = rig.board.as_ref().ok_or_else(|| {
        ProjectorError::needs(
            &rig_file,
            "[board] is missing",
            "describe the target of the sweep, or calibrate the projector elsewhere",
        )
    })?;
    let (set, code, size) = coded_set(rig, set)?;
    let shots = rig.positions()?;
    let folder = rig.root.join("calibration");

    clock.begin("find the boards");
    let detector = Detector::new(board)
        .map_err(|source| ProjectorError::Board { path: rig_file, source })?
        .with_camera(&rig.camera);
    let views = view_boards(rig, set, &code, &shots, &detector, opts, progress)?;

    clock.begin("solve the board poses");
    let trajectory = solve_trajectory(rig, &views, board.extent_mm, &folder, progress)?;

    clock.begin("fit the projector");
    let Gathered { samples, positions, lost } = gather(&views, &trajectory);
    if positions.len() < 3 || samples.len() < MIN_CORNERS {
        return Err(ProjectorError::needs(
            folder,
            format!(
                "{} corners at {} positions could be decoded, and {MIN_CORNERS} at 3 are needed",
                samples.len(),
                positions.len()
            ),
            "capture the board, lit by the whole code, at more positions",
        ));
    }
    let fitted = fit::fit(&samples, size, opts.lens).ok_or_else(|| {
        ProjectorError::needs(
            folder.clone(),
            "the corners do not determine a projector",
            "move the board through more depths, and check that patterns/ holds what was projected",
        )
    })?;
    if progress.cancelled() {
        return Err(ProjectorError::Cancelled);
    }

    clock.begin("measure the response");
    let response = measure_response(rig, &fitted.projector, board.extent_mm, &positions, &shots)?;
    let depths = samples.iter().map(|s| s.point.z);
    let center = fitted.projector.center();
    let report = ProjectorReport {
        set: set.name.clone(),
        positions: positions.len(),
        corners: samples.len() - fitted.rejected,
        rejected: fitted.rejected + lost,
        rms_px: fitted.rms_px,
        depth_mm: [depths.clone().fold(f64::INFINITY, f64::min), depths.fold(0.0, f64::max)],
        center_mm: center.coords.into(),
        center_sigma_mm: fitted.center_sigma_mm,
        response,
        stages: clock.finish(),
    };
    Ok((fitted.projector, report))
}

/// What was found at the board positions, in order.
#[derive(Default)]
struct BoardViews {
    /// The position's name, and its corners, or why there are none.
    corners: Vec<(String, Result<Vec<Corner>, String>)>,
    /// The projector pixel of each corner, where enough was decoded around it.
    decoded: Vec<Vec<Option<[f64; 2]>>>,
}

/// Detects the board at every position and decodes the pixels around its corners.
fn view_boards(
    rig: &Rig,
    set: &PatternSet,
    code: &Code,
    shots: &[Shot],
    detector: &Detector,
    opts: &ProjectorOptions,
    progress: &Progress,
) -> Result<BoardViews, ProjectorError> {
    let mut views = BoardViews::default();
    for (i, shot) in shots.iter().enumerate() {
        if progress.cancelled() {
            return Err(ProjectorError::Cancelled);
        }
        progress.tick(i, shots.len());
        let white = rig.reader(shot).read(&rig.white)?;
        let corners = detector.detect(&white.to_gray(), white.width, white.height);
        let corners: Result<Vec<Corner>, String> = corners.map_err(|e| e.to_string());
        let decoded = match &corners {
            Ok(corners) => {
                // A sweep rarely has inverses; use them if this position does.
                let mut here = set.clone();
                if !here.inverse.iter().all(|name| rig.has_image(&shot.dir.join(name))) {
                    here.inverse.clear();
                }
                let images = Images::read_position(rig, shot, &here)?;
                let captured = Captured::new(&images, rig, opts.min_contrast);
                let radius = opts.radius.unwrap_or((rig.camera.width.max(rig.camera.height) / 40).max(8));
                corners::decode(&captured, code, &here, corners, radius)?
            }
            Err(_) => Vec::new(),
        };
        views.decoded.push(decoded);
        views.corners.push((shot.name.clone(), corners));
    }
    Ok(views)
}

/// Finds the poses of the boards: those of the rig if it has any, else from the corners.
fn solve_trajectory(
    rig: &Rig,
    views: &BoardViews,
    extent_mm: [f64; 4],
    folder: &Path,
    progress: &Progress,
) -> Result<Trajectory, ProjectorError> {
    let trajectory = if rig.poses.is_empty() {
        Flatness::fit(&views.corners, &rig.camera, TrajectoryModel::Auto, extent_mm)
    } else {
        Trajectory::from_known(&rig.poses)
    };
    let trajectory = trajectory.map_err(|source| ProjectorError::Pose { path: folder.to_path_buf(), source })?;
    for r in &trajectory.rejected {
        progress.warn(format!("board position {} is not used: {}", r.position, r.reason));
    }
    Ok(trajectory)
}

/// The corners that the projector is fitted to.
struct Gathered {
    samples: Vec<Sample>,
    /// Index of each position that has samples, and its pose.
    positions: Vec<(usize, Isometry3<f64>)>,
    /// Corners around which too little was decoded.
    lost: usize,
}

/// Gathers the decoded corners of all positions that have a pose.
fn gather(views: &BoardViews, trajectory: &Trajectory) -> Gathered {
    let (mut samples, mut positions, mut lost) = (Vec::new(), Vec::new(), 0);
    for p in &trajectory.positions {
        let Some(at) = views.corners.iter().position(|(name, _)| *name == p.position) else { continue };
        let Ok(corners) = &views.corners[at].1 else { continue };
        let before = samples.len();
        for (corner, px) in corners.iter().zip(&views.decoded[at]) {
            let [x, y] = corner.board_mm;
            let point = p.cam_from_board * trajectory.bend().map_or(Point3::new(x, y, 0.0), |b| b.point([x, y]));
            match px {
                Some(px) => samples.push(Sample { point, px: *px }),
                None => lost += 1,
            }
        }
        if samples.len() > before {
            positions.push((at, p.cam_from_board));
        }
    }
    Gathered { samples, positions, lost }
}
