mod bend;
mod error;
mod flatness;
mod systematic;

use std::path::Path;
use std::time::Instant;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use nelu3d_scan::board::{Corner, Detector};
use nelu3d_scan::camera::Distortion;
use nelu3d_scan::pose::{PoseError, Position, Rejected, Trajectory, TrajectoryModel, solve_pnp};
use nelu3d_scan::rig::KnownPose;
use nelu3d_scan::{Camera, Rig};

use crate::board::render::Gauss;

type Detections = Vec<(String, Result<Vec<Corner>, String>)>;

/// A shared rig's detections, or `None` (loudly) where the shared data are not there.
fn detect_shared(name: &str) -> Option<(Rig, Detections)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(name);
    if !root.exists() {
        eprintln!("SKIPPED: the shared rig {} is not there", root.display());
        return None;
    }
    let rig = Rig::open(&root).unwrap();
    let detector = Detector::new(rig.board.as_ref().unwrap()).unwrap().with_camera(&rig.camera);
    let mut detections = Vec::new();
    let mut seconds = 0.0;
    for shot in rig.positions().unwrap() {
        let white = rig.read_image(&shot.dir.join(&rig.white)).unwrap();
        let gray = white.to_gray().into_owned();
        let start = Instant::now();
        let found = detector.detect(&gray, white.width, white.height).map_err(|e| e.to_string());
        seconds += start.elapsed().as_secs_f64();
        detections.push((shot.name, found));
    }
    eprintln!("{name}: {:.0} ms an image", 1e3 * seconds / detections.len() as f64);
    Some((rig, detections))
}

fn shared_rig(name: &str, n_positions: usize) {
    let Some((rig, detections)) = detect_shared(name) else { return };
    let free = Trajectory::fit(&detections, &rig.camera, TrajectoryModel::Free).unwrap();
    for p in &free.positions {
        let t = p.cam_from_board.translation;
        eprintln!(
            "{name} {}: {:.4} px, {} corners, {} rejected, z {:.3}",
            p.position,
            p.rms_px.unwrap(),
            p.n_corners,
            p.n_rejected,
            t.z
        );
    }
    let auto = Trajectory::fit(&detections, &rig.camera, TrajectoryModel::Auto).unwrap();
    eprintln!("{name}: {} because {}; {:?}", auto.model, auto.reason, auto.steps);
    for r in &auto.rejected {
        eprintln!("{name} {}: {}", r.position, r.reason);
    }
    assert_eq!(free.positions.len(), n_positions);
    assert_eq!(auto.positions.len(), n_positions);
    assert!(free.rms_px.unwrap() <= 0.05, "{:?}", free.rms_px);
    assert!(auto.rms_px.unwrap() <= 0.05, "{:?}", auto.rms_px);
}

#[test]
fn every_position_of_the_dlp_rig_is_found() {
    shared_rig("dlp", 34);
}

#[test]
fn every_position_of_the_film_rig_is_found() {
    shared_rig("film", 32);
}

fn camera() -> Camera {
    let distortion = Distortion::new(&[-0.12, 0.08, 0.001, -0.0015, 0.01]).unwrap();
    Camera { distortion, ..Camera::pinhole(640, 480, 900.0, 905.0, 317.0, 244.0) }
}

/// A grid of 9 × 7 corners, 20 mm apart.
fn grid() -> Vec<[f64; 2]> {
    (0..63).map(|i| [f64::from(i % 9) * 20.0, f64::from(i / 9) * 20.0]).collect()
}

fn pose(rotation: [f64; 3], translation: [f64; 3]) -> Isometry3<f64> {
    Isometry3::new(Vector3::from(translation), Vector3::from(rotation))
}

fn project(points: &[[f64; 2]], camera: &Camera, pose: &Isometry3<f64>, noise: f64, rng: &mut Gauss) -> Vec<Corner> {
    let see = |b: &[f64; 2]| {
        let p = camera.project(&(pose * Point3::new(b[0], b[1], 0.0))).unwrap();
        Corner { board_mm: *b, px: [p[0] + noise * rng.next(), p[1] + noise * rng.next()] }
    };
    points.iter().map(see).collect()
}

/// Angle (radians) and distance (mm) between two poses.
fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    (a.rotation.angle_to(&b.rotation), (a.translation.vector - b.translation.vector).norm())
}

#[test]
fn a_pose_comes_back_from_its_corners() {
    let (camera, mut rng) = (camera(), Gauss::new(1));
    for i in 0..50 {
        let mut between = |a: f64, b: f64| a + (b - a) * rng.uniform();
        // Any turn in the image, up to 57° of tilt, close and far.
        let spin = UnitQuaternion::from_scaled_axis(Vector3::z() * between(-3.1, 3.1));
        let tilt = UnitQuaternion::from_scaled_axis(Vector3::new(between(-0.7, 0.7), between(-0.7, 0.7), 0.0));
        let rotation = tilt * spin;
        let at = Vector3::new(between(-60.0, 60.0), between(-40.0, 40.0), between(400.0, 1500.0));
        let shift = at - rotation * Vector3::new(80.0, 60.0, 0.0);
        let truth = Isometry3::from_parts(shift.into(), rotation);
        let fit = solve_pnp(&project(&grid(), &camera, &truth, 0.0, &mut rng), &camera).unwrap();
        let (angle, distance) = apart(&fit.cam_from_board, &truth);
        // Limited by the rounding of a pixel coordinate (1e-13) times the leverage of a far, flat board (1e3).
        assert!(angle < 1e-7 && distance < 1e-5 && fit.rms_px < 1e-9, "{i}: {angle} {distance} {}", fit.rms_px);
        assert_eq!((fit.n_corners, fit.n_rejected), (63, 0));
    }
}

#[test]
fn wrong_corners_are_left_out() {
    let (camera, mut rng) = (camera(), Gauss::new(2));
    let truth = pose([0.2, -0.3, 0.1], [-80.0, -60.0, 500.0]);
    let mut corners = project(&grid(), &camera, &truth, 0.02, &mut rng);
    // A third of them: some anywhere, some one square off.
    for i in 0..21 {
        let k = 3 * i;
        corners[k].px = match i % 3 {
            0 => [640.0 * rng.uniform(), 480.0 * rng.uniform()],
            1 => [corners[k].px[0] + 36.0, corners[k].px[1]],
            _ => [corners[k].px[0], corners[k].px[1] + 0.5],
        };
    }
    let fit = solve_pnp(&corners, &camera).unwrap();
    let (angle, distance) = apart(&fit.cam_from_board, &truth);
    assert!((0..21).all(|i| !fit.used[3 * i]), "{:?}", fit.used);
    assert!(fit.n_corners >= 40 && fit.rms_px < 0.04, "{} {}", fit.n_corners, fit.rms_px);
    assert!(angle < 1e-3 && distance < 0.2, "{angle} {distance}");
}

/// Four corners of a small, far, tilted marker: its two poses differ by twice the tilt and by little in their
/// residuals.
#[test]
fn of_the_two_poses_of_a_plane_the_better_one_is_kept() {
    let (camera, mut rng) = (camera(), Gauss::new(3));
    let points = [[0.0, 0.0], [40.0, 0.0], [40.0, 40.0], [0.0, 40.0]];
    for i in 0..24 {
        let direction = f64::from(i) * std::f64::consts::TAU / 24.0;
        let truth = pose([0.6 * direction.cos(), 0.6 * direction.sin(), 0.0], [30.0, -20.0, 600.0]);
        let fit = solve_pnp(&project(&points, &camera, &truth, 0.005, &mut rng), &camera).unwrap();
        let (angle, distance) = apart(&fit.cam_from_board, &truth);
        assert!(angle < 0.05 && distance < 1.0, "tilted towards {direction}: {angle} rad, {distance} mm");
    }
}

#[test]
fn corners_that_fix_no_pose_are_refused() {
    let (camera, mut rng) = (camera(), Gauss::new(4));
    let truth = pose([0.1, 0.1, 0.0], [-80.0, -60.0, 500.0]);
    let corners = project(&grid(), &camera, &truth, 0.01, &mut rng);
    assert!(matches!(solve_pnp(&[], &camera), Err(PoseError::TooFewCorners { found: 0 })));
    assert!(matches!(solve_pnp(&corners[..3], &camera), Err(PoseError::TooFewCorners { found: 3 })));
    // One row, one point many times, and points that are not numbers.
    assert!(matches!(solve_pnp(&corners[..9], &camera), Err(PoseError::Collinear { .. })));
    assert!(matches!(solve_pnp(&[corners[0]; 8], &camera), Err(PoseError::Collinear { .. })));
    let mut broken = corners.clone();
    broken[5].px[1] = f64::NAN;
    assert!(matches!(solve_pnp(&broken, &camera), Err(PoseError::NotFinite { index: 5 })));
    // Three on a line and one beside it leave a pose open, too; four in general position do not.
    let three = [corners[0], corners[1], corners[2], corners[20]];
    assert!(solve_pnp(&three, &camera).is_err());
    assert!(solve_pnp(&[corners[0], corners[8], corners[62], corners[54]], &camera).is_ok());
}

/// A sweep with the same rotation, along a line, in uneven steps; `wobble` tilts each position (radians).
fn sweep(n: usize, wobble: f64, uneven: f64, noise: f64) -> (Camera, Vec<Isometry3<f64>>, Detections) {
    let (camera, mut rng) = (camera(), Gauss::new(n as u64));
    let mut poses = Vec::new();
    let mut found = Vec::new();
    for i in 0..n {
        let s = 6.0 * i as f64 + uneven * rng.next();
        let tilt = [0.1 + wobble * rng.next(), -0.15 + wobble * rng.next(), 0.05];
        let truth = pose(tilt, [-80.0 + 0.02 * s, -60.0 - 0.03 * s, 450.0 + 0.999 * s]);
        found.push((format!("{i:03}"), Ok(project(&grid(), &camera, &truth, noise, &mut rng))));
        poses.push(truth);
    }
    (camera, poses, found)
}

fn worst(trajectory: &Trajectory, truth: &[Isometry3<f64>]) -> (f64, f64) {
    let of = |p: &Position| apart(&p.cam_from_board, &truth[p.position.parse::<usize>().unwrap()]);
    trajectory.positions.iter().map(of).fold((0.0, 0.0), |a, b| (f64::max(a.0, b.0), f64::max(a.1, b.1)))
}

#[test]
fn a_stage_is_recognized_and_beats_free_poses() {
    let (camera, truth, mut found) = sweep(12, 0.0, 0.3, 0.05);
    found[4].1 = Err("the lamp was off".into());
    // Bad corners in one position must not spoil the others.
    if let Ok(corners) = &mut found[7].1 {
        corners.iter_mut().step_by(4).for_each(|c| c.px[0] += 3.0);
    }
    let auto = Trajectory::fit(&found, &camera, TrajectoryModel::Auto).unwrap();
    let free = Trajectory::fit(&found, &camera, TrajectoryModel::Free).unwrap();
    assert_eq!((auto.model, free.model), ("stage", "free"), "{}", auto.reason);
    assert_eq!(auto.positions.len(), 11);
    assert_eq!(auto.rejected, [Rejected { position: "004".into(), reason: "the lamp was off".into() }]);
    let (stage, single) = (worst(&auto, &truth), worst(&free, &truth));
    eprintln!("stage {stage:?}, free {single:?} (rad, mm); {}", auto.reason);
    assert!(stage.0 < 5e-4 && stage.1 < 0.1, "{stage:?}");
    assert!(stage.0 < 0.5 * single.0, "{stage:?} {single:?}");
    let steps = auto.steps.unwrap();
    assert!((steps.mean_mm - 6.0).abs() < 0.1 && (0.1..0.6).contains(&steps.deviation_mm), "{steps:?}");
    assert!(auto.rms_px.unwrap() < 0.09 && auto.rms_free_px.unwrap() <= auto.rms_stage_px.unwrap());
}

#[test]
fn a_board_held_by_hand_stays_free() {
    let (camera, truth, found) = sweep(10, 0.02, 0.5, 0.02);
    let auto = Trajectory::fit(&found, &camera, TrajectoryModel::Auto).unwrap();
    assert_eq!(auto.model, "free", "{}", auto.reason);
    assert!(auto.rms_stage_px.unwrap() > 3.0 * auto.rms_free_px.unwrap());
    let w = worst(&auto, &truth);
    assert!(w.0 < 1e-3 && w.1 < 0.2, "{w:?}");
}

#[test]
fn a_bumped_position_is_left_out_of_a_stage() {
    let (camera, truth, mut found) = sweep(12, 0.0, 0.3, 0.02);
    let bumped = pose([0.13, -0.1, 0.07], [-75.0, -66.0, 480.0]);
    found[5].1 = Ok(project(&grid(), &camera, &bumped, 0.02, &mut Gauss::new(9)));
    let stage = Trajectory::fit(&found, &camera, TrajectoryModel::Stage).unwrap();
    assert_eq!(stage.rejected.iter().map(|r| r.position.as_str()).collect::<Vec<_>>(), ["005"]);
    let w = worst(&stage, &truth);
    assert!(stage.positions.len() == 11 && w.0 < 2e-4 && w.1 < 0.05, "{w:?}");
}

#[test]
fn equal_steps_fill_gaps_and_uneven_ones_do_not() {
    let (camera, truth, mut found) = sweep(12, 0.0, 0.0, 0.02);
    for i in [0, 5, 6] {
        found[i].1 = Err("too dark".into());
    }
    let equal = Trajectory::fit(&found, &camera, TrajectoryModel::StageEqualSteps).unwrap();
    assert_eq!(equal.model, "stage-equal-steps");
    let names: Vec<String> = equal.positions.iter().map(|p| p.position.clone()).collect();
    assert_eq!(names, (0..12).map(|i| format!("{i:03}")).collect::<Vec<_>>());
    assert!(equal.rejected.is_empty() && equal.positions[5].rms_px.is_none());
    let w = worst(&equal, &truth);
    assert!(w.0 < 2e-4 && w.1 < 0.05, "{w:?}");
    let any = Trajectory::fit(&found, &camera, TrajectoryModel::Stage).unwrap();
    assert_eq!((any.positions.len(), any.rejected.len()), (9, 3));
}

#[test]
fn a_sweep_needs_three_positions_and_says_why_not() {
    let (camera, _, mut found) = sweep(5, 0.0, 0.0, 0.02);
    found[1].1 = Err("no board".into());
    found[2].1 = Ok(Vec::new());
    found[3].1 = Err("too dark".into());
    for model in [TrajectoryModel::Auto, TrajectoryModel::Free, TrajectoryModel::Stage] {
        let message = Trajectory::fit(&found, &camera, model).unwrap_err().to_string();
        assert!(
            message.contains("2 of 5") && message.contains("001: no board") && message.contains("002"),
            "{message}"
        );
    }
    assert!(Trajectory::fit(&[], &camera, TrajectoryModel::Auto).is_err());
    // Three are enough.
    let (camera, truth, found) = sweep(3, 0.0, 0.0, 0.02);
    for model in
        [TrajectoryModel::Auto, TrajectoryModel::Free, TrajectoryModel::Stage, TrajectoryModel::StageEqualSteps]
    {
        let w = worst(&Trajectory::fit(&found, &camera, model).unwrap(), &truth);
        assert!(w.0 < 1e-3 && w.1 < 0.2, "{model:?}: {w:?}");
    }
}

#[test]
fn known_poses_pass_through_and_are_reported() {
    let known =
        |i: usize| KnownPose { position: format!("{i:03}"), cam_from_board: pose([0.0, 0.1, 0.0], [1.0, 2.0, 600.0]) };
    let poses: Vec<KnownPose> = (0..4).map(known).collect();
    let trajectory = Trajectory::from_known(&poses).unwrap();
    assert_eq!(trajectory.positions[2].cam_from_board, poses[2].cam_from_board);
    let json = serde_json::to_value(&trajectory).unwrap();
    assert_eq!(json["model"], "known");
    assert_eq!(json["positions"][3]["cam_from_board"]["translation"][2], 600.0);
    assert!(Trajectory::from_known(&poses[..2]).is_err());
}
