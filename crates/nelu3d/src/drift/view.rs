//! One look at the board: where it is, what it shows, and whether it stands where it stood in the sweep.

use nalgebra::{Isometry3, Point3};
use nelu3d_scan::board::{Corner, Detector};
use nelu3d_scan::pose::{Bend, solve_pnp};
use nelu3d_scan::rig::{Capture, Shot};
use nelu3d_scan::statistics::median;
use nelu3d_scan::{Image, Rig};

use super::samples::BoardSamples;
use crate::calibrate::BoardPlane;
use crate::color_field::ColorField;

/// Largest displacement of the corners from a place of the sweep, as a part of the image's width, at which a board may
/// have been left there.
const LEFT: f64 = 0.15;
/// Fewest corners that two views have to share.
const MIN_SHARED: usize = 4;
/// Steps toward the pose of a bent board.
const BEND_STEPS: usize = 3;
/// Largest root mean square reprojection error of corners that tell where a board is, px.
const MAX_RMS_PX: f64 = 1.5;

/// A board in view.
pub(super) struct BoardView {
    /// Pixels that see the board, and what they measured.
    pub(super) samples: BoardSamples,
    /// Pose of the board, camera from board, mm.
    pub(super) pose: Isometry3<f64>,
    /// Root mean square reprojection error of the board's corners, px.
    pub(super) rms_px: f64,
    /// Place of the sweep where the board may stand.
    pub(super) place: Option<Place>,
}

/// A place of the sweep, as seen from now.
pub(super) struct Place {
    /// Name of the position.
    pub(super) position: String,
    /// The board's pose then, camera from board, mm.
    pub(super) pose: Isometry3<f64>,
    /// Median displacement of the corners since then, px.
    pub(super) corners_px: [f64; 2],
}

impl BoardView {
    /// Looks at a capture of the rig's board.
    ///
    /// # Errors
    ///
    /// What is missing, as a part of a sentence.
    pub(super) fn new(rig: &Rig, capture: &Capture, field: &ColorField) -> Result<Self, String> {
        let board = rig.board.as_ref().ok_or("rig.toml describes no board")?;
        let detector = &Detector::new(board).map_err(|e| e.to_string())?.with_camera(&rig.camera);
        let bend = field.metadata.board_bend.as_ref();
        let (corners, pose, rms_px) = locate(rig, detector, &capture.white, bend)?;
        let samples = BoardSamples::new(
            capture,
            &rig.camera,
            &BoardPlane::new(&pose, board.extent_mm, bend.copied()),
            &corners,
            field,
        )
        .ok_or("the board in view stands outside the calibrated volume, or in the dark")?;
        Ok(Self { samples, pose, rms_px, place: place(rig, detector, &corners, field) })
    }

    /// Returns how far the light's pattern moves on the board as the camera sees it if the board moves from here to
    /// where another frame's white image shows it, root mean square, px; 0 where that frame has no board.
    pub(super) fn moves_px(&self, rig: &Rig, white: &Image, field: &ColorField) -> f64 {
        let bend = field.metadata.board_bend.as_ref();
        let there = rig.board.as_ref().and_then(|board| {
            let detector = Detector::new(board).ok()?.with_camera(&rig.camera);
            locate(rig, &detector, white, bend).ok()
        });
        let Some((_, there, _)) = there else { return 0.0 };
        // The light against the board moves the other way.
        let shifts = self.samples.shifts_px(field, &rig.camera, &(self.pose * there.inverse()));
        let n = shifts.len().max(1) as f64;
        (shifts.iter().map(|s| s[0] * s[0] + s[1] * s[1]).sum::<f64>() / n).sqrt()
    }
}

/// Finds the corners of the board in a white image, and its pose.
fn locate(
    rig: &Rig,
    detector: &Detector,
    white: &Image,
    bend: Option<&Bend>,
) -> Result<(Vec<Corner>, Isometry3<f64>, f64), String> {
    let corners = detector.detect(&white.to_gray(), white.width, white.height).map_err(|e| e.to_string())?;
    let mut fit = solve_pnp(&corners, &rig.camera).map_err(|e| e.to_string())?;
    for _ in 0..if bend.is_some() { BEND_STEPS } else { 0 } {
        let flat = bend.map_or_else(Vec::new, |b| b.flattened(&corners, &rig.camera, &fit.cam_from_board));
        fit = solve_pnp(&flat, &rig.camera).map_err(|e| e.to_string())?;
    }
    if fit.rms_px > MAX_RMS_PX {
        return Err(format!("the corners of the board in view fit to {:.1} px only", fit.rms_px));
    }
    let used = corners.into_iter().zip(&fit.used).filter(|(_, used)| **used).map(|(c, _)| c).collect();
    Ok((used, fit.cam_from_board, fit.rms_px))
}

/// Returns the place of the sweep where the board may stand: that at which the corners lie most alike, up to a shift.
fn place(rig: &Rig, detector: &Detector, corners: &[Corner], field: &ColorField) -> Option<Place> {
    let alike = |pose: &Isometry3<f64>| {
        let on_board = |[x, y]: [f64; 2]| match &field.metadata.board_bend {
            Some(bend) => bend.point([x, y]),
            None => Point3::new(x, y, 0.0),
        };
        let seen = |c: &Corner| Some(Corner { px: rig.camera.project(&(pose * on_board(c.board_mm)))?, ..*c });
        let then: Vec<Corner> = corners.iter().map(seen).collect::<Option<_>>()?;
        let shift = displacement(corners, &then)?;
        let off = corners
            .iter()
            .zip(&then)
            .map(|(a, b)| (a.px[0] - b.px[0] - shift[0]).powi(2) + (a.px[1] - b.px[1] - shift[1]).powi(2));
        (shift[0].hypot(shift[1]) < LEFT * rig.camera.width as f64).then(|| (off.sum::<f64>(), shift))
    };
    let found = field.metadata.boards.iter().filter_map(|b| Some((alike(&b.pose())?, b)));
    let ((_, shift), board) = found.min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
    // The corners themselves, where they are still there, are better known than those that the pose predicts.
    let shot = Shot { name: board.position.clone(), dir: rig.root.join("calibration").join(&board.position) };
    let before = rig
        .reader(&shot)
        .read(&rig.white)
        .ok()
        .and_then(|white| locate(rig, detector, &white, field.metadata.board_bend.as_ref()).ok());
    let seen = before.and_then(|(then, ..)| displacement(corners, &then));
    Some(Place { position: board.position.clone(), pose: board.pose(), corners_px: seen.unwrap_or(shift) })
}

/// Returns the median displacement of the corners that two views share, px.
fn displacement(now: &[Corner], then: &[Corner]) -> Option<[f64; 2]> {
    let same = |a: &Corner, b: &Corner| (0..2).all(|i| (a.board_mm[i] - b.board_mm[i]).abs() < 1e-6);
    let pairs: Vec<_> = now.iter().filter_map(|a| Some((a, then.iter().find(|b| same(a, b))?))).collect();
    let along = |i: usize| median(&mut pairs.iter().map(|(a, b)| a.px[i] - b.px[i]).collect::<Vec<_>>());
    (pairs.len() >= MIN_SHARED).then(|| Some([along(0)?, along(1)?])).flatten()
}
