//! Calibration: from a board sweep to a color field (paper, Sec. 3.1): find the boards and their poses, find the center
//! of the light, fit c, and measure its quality at held-out positions.

#[doc(hidden)]
pub mod binning;
mod board_poses;
mod board_samples;
mod candidate;
#[doc(hidden)]
pub mod depth_noise;
#[doc(hidden)]
pub mod drawn;
mod error;
mod excluded;
mod frame_choice;
#[doc(hidden)]
pub mod fringes;
#[doc(hidden)]
pub mod held_out;
#[doc(hidden)]
pub mod judge;
mod kept_images;
#[doc(hidden)]
pub mod light;
mod options;
mod pass;
mod placed_sweep;
mod pose_refinement;
#[doc(hidden)]
pub mod position;
mod predictor;
#[doc(hidden)]
pub mod relief;
#[doc(hidden)]
pub mod relief_fit;
mod report;
mod resolution;
#[doc(hidden)]
pub mod shared_displacement;
#[doc(hidden)]
pub mod smoothing;
#[doc(hidden)]
pub mod spline_fit;
mod support;
#[doc(hidden)]
pub mod sweep;
#[doc(hidden)]
pub mod views;

use nalgebra::Isometry3;
use nelu3d_field::device::Device;
use nelu3d_scan::Rig;
use nelu3d_scan::pose::Trajectory;
use nelu3d_scan::rig::PatternSet;

use crate::color_field::frame::Center;
use crate::color_field::{ColorField, FieldMetadata, camera_key};
use crate::progress::{Progress, StageClock};
pub use board_poses::{SweepFacts, SweepGeometry, solve_board_poses};
pub(crate) use board_samples::{BoardSample, BoardSamples, board_samples};
use candidate::Candidate;
pub use error::CalibrationError;
pub use fringes::CarriedReport;
pub(crate) use held_out::Displacement;
pub use judge::DepthSpan;
use judge::{Evidence, HeldOut, judge};
pub use options::{CalibrationOptions, FormKind, FrameKind, TrajectoryKind};
pub use placed_sweep::{BoardPlane, PlacedSweep};
pub use pose_refinement::PoseRefinement;
pub use position::Position;
pub use report::CalibrationReport;
pub(crate) use shared_displacement::Sample;
pub use sweep::Sweep;

/// Calibrates a rig for one pattern set from its board sweep.
///
/// # Errors
///
/// The rig, its board or its images cannot be used, too few positions have a pose, no sample is usable, the device is
/// not there, or the caller stopped the work.
pub fn calibrate(
    rig: &Rig,
    set: &PatternSet,
    opts: &CalibrationOptions,
    progress: &Progress,
) -> Result<(ColorField, CalibrationReport), CalibrationError> {
    if opts.form == FormKind::Published {
        opts.published.check(set.images.len() * rig.channels.count())?;
    }
    let device = Device::open(opts.device)?;
    let mut clock = StageClock::new(progress);
    let mut geometry = solve_board_poses(rig, set, opts, progress, &mut clock)?;
    let mut placed = geometry.placed;

    clock.begin("find the light");
    let views = views::estimate_noise(&mut placed, rig, opts.frame != FrameKind::Camera, progress)?;
    let found = views.and_then(|views| light::find_center(views, &placed.camera, progress));
    placed.move_drawn();
    let outliers = found.as_ref().map_or(&[][..], |f| &f.without_consensus);
    let without_consensus: Vec<String> = outliers.iter().map(|p| placed.sweep.shots[*p].name.clone()).collect();
    let blocks = found.as_ref().map_or(&[][..], |f| &f.excluded);
    let excluded: Vec<(String, f64)> =
        blocks.iter().map(|(p, blocks)| (placed.sweep.shots[*p].name.clone(), blocks.share())).collect();
    placed.exclude(blocks);
    placed.remove(outliers);
    let light = found.map(|f| f.center);

    clock.begin("fit the field without the held-out positions");
    // The published form knows nothing of the light.
    let light = light.filter(|_| opts.form != FormKind::Published);
    let (mut best, refined) = frame_choice::fit_best_frame(&mut placed, light.as_ref(), opts, &device, progress)?;
    if let Some(refined) = &refined {
        move_boards(&mut geometry.trajectory, &placed, &refined.motions);
    }

    clock.begin("fit the field to all positions");
    let fit = candidate::FitContext { placed: &placed, opts, device: &device, progress };
    let form = best.fit_all_positions(&fit)?;
    if progress.cancelled() {
        return Err(CalibrationError::Cancelled);
    }

    let metadata = FieldMetadata {
        version: env!("CARGO_PKG_VERSION").into(),
        rig: rig.name.clone(),
        set: set.name.clone(),
        images: set.images.clone(),
        mono: placed.sweep.mono(),
        channels: placed.sweep.channels,
        center: best.center,
        source: "sweep".into(),
        camera: camera_key(&rig.camera),
        noise: placed.sensor_noise(),
        blur: Some(placed.sensor_blur),
        dark: geometry.dark,
        crosstalk: None,
        cells_per_pixel: best.cells_per_pixel,
        step_mm: placed.typical_step_mm(),
        quality: Some(best.quality.clone()),
        residual: None,
        warnings: Vec::new(),
        boards: board_poses::places(&geometry.trajectory, &placed),
        board_bend: geometry.trajectory.bend().copied(),
        corrected: Vec::new(),
        settings: serde_json::to_value(opts).expect("plain data serializes"),
    };
    let shortfall = frame_choice::shortfall(&best, light.as_ref(), opts.form);
    let Candidate { frame, center, cells, validity, quality, variance, gross, carried, .. } = best;
    let mut field = ColorField { frame, form, validity, metadata };

    clock.begin("judge the field");
    let gross = gross.map(|gross| (placed.sweep.shots[gross.position].name.as_str(), gross));
    let held_out = HeldOut { quality: &quality, shortfall: shortfall.as_deref(), variance, gross };
    let evidence = Evidence {
        facts: &geometry.facts,
        steps: geometry.trajectory.steps.as_ref(),
        step_mm: opts.step_mm,
        held_out,
        without_consensus: &without_consensus,
        excluded: &excluded,
    };
    let judgment = judge(&field, &placed, &evidence);
    field.metadata.warnings = judgment.warnings.iter().map(|w| w.code.name()).collect();
    let report = CalibrationReport {
        judgment,
        boards_mm: Some(DepthSpan::of(&placed)),
        corner_rms_px: geometry.trajectory.rms_px,
        trajectory: Some(geometry.trajectory),
        light_mm: (center == Center::Light).then(|| field.frame.center()).flatten().map(|c| [c.x, c.y, c.z]),
        quality: Some(quality),
        frame: frame_choice::reason(center, light.as_ref(), opts),
        shortfall,
        excluded,
        refined_poses: refined.map(|r| r.report),
        carried,
        cells,
        stages: clock.finish(),
    };
    Ok((field, report))
}

/// Moves the boards of the positions that are used.
fn move_boards(trajectory: &mut Trajectory, placed: &PlacedSweep<'_>, motions: &[Isometry3<f64>]) {
    for (shot, motion) in placed.sweep.shots.iter().zip(motions) {
        let of_shot = trajectory.positions.iter_mut().filter(|p| p.position == shot.name);
        of_shot.for_each(|p| p.cam_from_board = motion * p.cam_from_board);
    }
}
