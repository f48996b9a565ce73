//! Whether camera or light source moved since the sweep, by the board, left or put back anywhere in the calibrated
//! volume.
//!
//! The board's corners tell where its plane is, and the field which codewords that plane would show if nothing had
//! moved. The rigid motion of the light in the camera's frame that explains the difference is found by Gauss-Newton on
//! codewords. One board tells a motion up to what its plane does not show (a turn of the light looks like a shift);
//! what it leaves open is taken to be a turn about the center of what was bumped, and several boards leave less open.
//!
//! Field and board know camera and light by their relative motion only. Which of them moved is told by a board that
//! stands where it stood at a position of the sweep: then the camera stood still if the corners are where they were,
//! and light and board stood still if the board carries the codewords that it carried there.

mod correct;
mod error;
mod fit;
mod report;
mod samples;
mod view;

use nelu3d_scan::rig::{Capture, Need, PatternSet, Shot};
use nelu3d_scan::statistics::median;
use nelu3d_scan::{Image, Rig};

use crate::color_field::{ColorField, LightMotion, check_field, check_mono};
use crate::progress::Progress;
pub use correct::correct;
pub use error::DriftError;
use fit::Comparison;
pub use report::{DriftReport, Moved};
use samples::BoardSamples;
use view::BoardView;

/// Displacement of the pattern on the board from which something moved, px.
const MOVED_PX: f64 = 0.2;
/// Displacement of the corners from a place of the sweep up to which the camera stood still, px.
const STILL_PX: f64 = 0.15;
/// Displacement of the pattern by a board's own motion from one frame to the next from which it moves, px; errors of
/// its pose stay below.
const MOVES_PX: f64 = 0.1;
/// Median χ² per measurement up to which a motion explains what is seen, whatever it was without it.
const EXPLAINED: f64 = 2.5;
/// Part of the median χ² without a motion that it has to leave at most. Errors of the field and of the board's pose
/// look like small motions, which take away a tenth or a fifth on real boards that never moved.
const MIN_GAIN: f64 = 0.75;

/// Checks captures of the rig's board against a field: several views of it are explained by one motion.
///
/// # Errors
///
/// The field belongs to something else, an image cannot be read, the rig describes no board, the board is not found or
/// stands outside the calibrated volume, or the caller stopped the work.
pub fn check_drift(
    rig: &Rig,
    set: &PatternSet,
    shots: &[Shot],
    field: &ColorField,
    progress: &Progress,
) -> Result<DriftReport, DriftError> {
    check_field(rig, set, field)?;
    progress.stage("find the board");
    let mut views = Vec::with_capacity(shots.len());
    for (i, shot) in shots.iter().enumerate() {
        progress.tick(i, shots.len());
        if progress.cancelled() {
            return Err(DriftError::Cancelled);
        }
        let capture = rig.read_shot(shot, set, Need::Scene)?;
        check_mono(&capture, set, shot, field)?;
        let view = BoardView::new(rig, &capture, field);
        views.push(view.map_err(|reason| DriftError::NoBoard { path: shot.dir.clone(), reason })?);
    }
    progress.stage("compare codewords");
    Ok(compare(rig, &views, field))
}

/// Checks a scene that may have the board, or a part of it, in view.
///
/// # Errors
///
/// Why nothing was checked, as a part of a sentence.
pub fn check_capture(rig: &Rig, capture: &Capture, field: &ColorField) -> Result<DriftReport, String> {
    Ok(compare(rig, &[BoardView::new(rig, capture, field)?], field))
}

/// Checks a frame of a sequence, whose patterns may show another moment than its white image, like [`check_capture`].
/// `neighbors` are the white images of the frames before and after it: a board that moves from one to the next tells
/// nothing where its own motion explains what was found.
///
/// # Errors
///
/// Why nothing was checked, as a part of a sentence.
pub fn check_frame(
    rig: &Rig,
    capture: &Capture,
    neighbors: &[&Image],
    field: &ColorField,
) -> Result<DriftReport, String> {
    let view = BoardView::new(rig, capture, field)?;
    let report = compare(rig, std::slice::from_ref(&view), field);
    if report.moved == Moved::Nothing {
        return Ok(report);
    }
    let moves_px = neighbors.iter().map(|white| view.moves_px(rig, white, field)).fold(0.0, f64::max);
    tracing::debug!(moves_px, shift_px = report.shift_px, "the board's own motion");
    // A pattern is no further than a frame from its white image.
    let explained = moves_px > MOVES_PX && (!report.rigid || report.shift_px < 2.0 * moves_px);
    if explained { Err("the board in view moves".into()) } else { Ok(report) }
}

/// Finds the motion, and who made it.
fn compare(rig: &Rig, views: &[BoardView], field: &ColorField) -> DriftReport {
    let (samples, grid) = (views.iter().map(|v| &v.samples).collect::<Vec<_>>(), field.to_grid());
    let comparison = Comparison { views: &samples, field, grid: &grid };
    let camera = [0.0; 3];
    let light = field.frame.center().map_or(camera, |c| c.coords.into());
    let still = comparison.chi2(&LightMotion::none(camera));
    let mut motion = comparison.fit(light);
    let shift = Shift::of(&samples, rig, field, &motion);
    let mut chi2 = comparison.chi2(&motion);

    let placed = views.iter().filter_map(|v| Some((v, v.place.as_ref()?)));
    // The place whose corners are nearest to where they were tells most.
    let off = |px: &[f64; 2]| px[0].hypot(px[1]);
    let at = placed.min_by(|a, b| off(&a.1.corners_px).total_cmp(&off(&b.1.corners_px)));
    let moved = match at {
        _ if shift.px < MOVED_PX && still < EXPLAINED.max(2.0 * chi2) => Moved::Nothing,
        _ if chi2 > MIN_GAIN * still && still < 2.0 * EXPLAINED => Moved::Nothing,
        Some((_, place)) if off(&place.corners_px) < STILL_PX => Moved::Light,
        Some((view, place)) => {
            let then_from_now = place.pose * view.pose.inverse();
            let mut as_then = view.samples.misfits(field, &grid, &then_from_now, 1);
            let as_then = median(&mut as_then).unwrap_or(f64::INFINITY);
            tracing::debug!(as_then, chi2, still, "the board's codewords at its place of the sweep");
            if as_then < 1.5 * chi2.max(0.5) { Moved::Camera } else { Moved::Unknown }
        }
        None => Moved::Unknown,
    };
    if moved == Moved::Camera {
        motion = comparison.fit(camera);
        chi2 = comparison.chi2(&motion);
    }
    let shift = Shift::of(&samples, rig, field, &motion);
    let place = at.map(|(_, place)| place);
    DriftReport {
        moved,
        shift_px: shift.px,
        direction_px: shift.mean,
        motion,
        rigid: chi2 < EXPLAINED,
        chi2_still: still,
        chi2_moved: chi2,
        corner_rms_px: views.iter().map(|v| v.rms_px).fold(0.0, f64::max),
        position: place.map(|p| p.position.clone()),
        corners_px: place.map(|p| p.corners_px),
    }
}

/// How far the pattern moved on the boards, as the camera sees it.
struct Shift {
    /// Root mean square, px.
    px: f64,
    /// Mean along x and y, px.
    mean: [f64; 2],
}

impl Shift {
    fn of(views: &[&BoardSamples], rig: &Rig, field: &ColorField, motion: &LightMotion) -> Self {
        let motion = motion.isometry();
        let all: Vec<[f64; 2]> = views.iter().flat_map(|v| v.shifts_px(field, &rig.camera, &motion)).collect();
        let n = all.len().max(1) as f64;
        let square = all.iter().map(|s| s[0] * s[0] + s[1] * s[1]).sum::<f64>() / n;
        Self { px: square.sqrt(), mean: [0, 1].map(|i| all.iter().map(|s| s[i]).sum::<f64>() / n) }
    }
}
