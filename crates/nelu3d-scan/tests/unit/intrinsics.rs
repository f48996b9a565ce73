use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use nelu3d_scan::Camera;
use nelu3d_scan::board::Corner;
use nelu3d_scan::camera::Distortion;
use nelu3d_scan::intrinsics::{
    GrayImage, IntrinsicsError, IntrinsicsOptions, LensModel, StageStep, View, calibrate_intrinsics, find_boards,
};

use crate::board::render::Gauss;

/// Corners of a board of 9 × 7 at poses drawn by hand, with noise; those outside the picture are missing.
fn sweep(camera: &Camera, n: usize, tilt: f64, noise_px: f64, bend_mm: f64, seed: u64) -> Vec<View> {
    let mut rng = Gauss::new(seed);
    let mut views = Vec::new();
    // The board is larger than the picture at this depth: its corners are covered, without which k3 stays open there.
    let depth = 200.0 * camera.fx / camera.width as f64 * 0.95;
    for i in 0..n {
        let turn = Vector3::new(tilt * rng.next(), tilt * rng.next(), 0.2 * rng.next());
        let at = Vector3::new(25.0 * rng.next(), 20.0 * rng.next(), depth * (1.0 + 0.15 * rng.next()));
        let rotation = UnitQuaternion::from_scaled_axis(turn);
        let pose = Isometry3::from_parts(Translation3::from(at), rotation);
        views.push(view(camera, &pose, noise_px, bend_mm, i, &mut rng));
    }
    views
}

fn view(camera: &Camera, pose: &Isometry3<f64>, noise: f64, bend_mm: f64, i: usize, rng: &mut Gauss) -> View {
    let mut corners = Vec::new();
    for r in 0..7 {
        for c in 0..9 {
            let board_mm = [25.0 * (c as f64 - 4.0), 25.0 * (r as f64 - 3.0)];
            let depth = bend_mm * (board_mm[0] / 100.0).powi(2);
            let p = pose * Point3::new(board_mm[0], board_mm[1], depth);
            let [x, y] = camera.project(&p).unwrap();
            let px = [x + noise * rng.next(), y + noise * rng.next()];
            let inside = px[0] > 2.0 && px[1] > 2.0 && px[0] < camera.width as f64 && px[1] < camera.height as f64;
            if inside {
                corners.push(Corner { board_mm, px });
            }
        }
    }
    View { name: format!("{i:03}"), number: i, corners }
}

fn cameras() -> Vec<(LensModel, Camera)> {
    let lens = |k: &[f64], camera: Camera| Camera { distortion: Distortion::new(k).unwrap(), ..camera };
    vec![
        (LensModel::Pinhole, Camera::pinhole(640, 480, 900.0, 903.0, 317.0, 244.0)),
        (LensModel::Four, lens(&[-0.11, 0.09, 8e-4, -6e-4], Camera::pinhole(640, 480, 760.0, 758.0, 322.4, 236.9))),
        (
            LensModel::Five,
            lens(&[-0.28, 0.1, 1e-3, 5e-4, -0.01], Camera::pinhole(1280, 960, 1200.0, 1202.0, 630.0, 490.0)),
        ),
    ]
}

/// Largest difference of two cameras' distortion over the picture, px: shifts, magnification, and a turn apart.
fn distortion_error(a: &Camera, b: &Camera) -> f64 {
    let mut rows = Vec::new();
    for y in 0..13 {
        for x in 0..17 {
            let px = [x as f64 / 16.0 * (a.width as f64 - 1.0), y as f64 / 12.0 * (a.height as f64 - 1.0)];
            let [u, v] = a.undistort(px);
            let q = b.project(&Point3::new(u, v, 1.0)).unwrap();
            rows.push((px, [q[0] - px[0], q[1] - px[1]]));
        }
    }
    let n = 2 * rows.len();
    let design = nalgebra::DMatrix::from_fn(n, 5, |i, j| {
        let ([x, y], k) = (rows[i / 2].0, i % 2);
        [
            f64::from(u8::from(k == 0)),
            f64::from(u8::from(k == 1)),
            if k == 0 { x } else { 0.0 },
            if k == 1 { y } else { 0.0 },
            if k == 0 { -y } else { x },
        ][j]
    });
    let seen = nalgebra::DVector::from_fn(n, |i, _| rows[i / 2].1[i % 2]);
    let fit = design.clone().svd(true, true).solve(&seen, 1e-12).unwrap();
    let left = seen - design * fit;
    (0..rows.len()).map(|i| left[2 * i].hypot(left[2 * i + 1])).fold(0.0, f64::max)
}

#[test]
fn cameras_are_found_within_their_standard_deviations() {
    let (mut squares, mut n) = (0.0, 0.0);
    for (model, camera) in cameras() {
        for seed in 1..=3 {
            let views = sweep(&camera, 24, 0.4, 0.05, 0.0, seed);
            let options = IntrinsicsOptions::default();
            let found = calibrate_intrinsics(&views, [camera.width, camera.height], &options).unwrap();
            let (r, c) = (&found.report, &found.camera);
            let errors = [c.fx - camera.fx, c.fy - camera.fy, c.cx - camera.cx, c.cy - camera.cy];
            let distortion = distortion_error(&camera, c);
            eprintln!(
                "{model:?} {seed}: {} coefficients, errors {errors:.3?} ± {:.3?}, distortion {distortion:.3} px, rms {:.4}",
                r.coefficients, r.pinhole_sigma_px, r.rms_px
            );
            assert!(errors[0].abs() < 1e-3 * camera.fx && errors[1].abs() < 1e-3 * camera.fx, "{errors:?}");
            assert!(errors[2].abs() < 1.0 && errors[3].abs() < 1.0, "{errors:?}");
            assert!(distortion < 0.1, "{distortion}");
            assert!(r.coefficients >= model.coefficients().min(4), "{:?}", r.models);
            assert!((r.corner_sigma_px - 0.05).abs() < 0.01, "{}", r.corner_sigma_px);
            for (e, s) in errors.iter().zip(r.pinhole_sigma_px) {
                assert!(e.abs() < 4.0 * s, "{e} ± {s}");
                (squares, n) = (squares + (e / s).powi(2), n + 1.0);
            }
            assert!(r.bend_mm.is_none(), "{:?}", r.models);
        }
    }
    let spread = f64::sqrt(squares / n);
    eprintln!("errors over their standard deviations: RMS {spread:.2}");
    assert!((0.3..1.4).contains(&spread), "{spread}");
}

#[test]
fn outliers_and_bent_boards_do_not_spoil_a_camera() {
    let (_, camera) = cameras().swap_remove(1);
    let mut views = sweep(&camera, 24, 0.4, 0.05, 0.0, 7);
    for (i, view) in views.iter_mut().enumerate() {
        let k = i % view.corners.len();
        view.corners[k].px[0] += 6.0;
    }
    let size = [camera.width, camera.height];
    let found = calibrate_intrinsics(&views, size, &IntrinsicsOptions::default()).unwrap();
    assert!(found.report.rejected >= 20 && (found.camera.fx - camera.fx).abs() < 1e-3 * camera.fx);

    let bent = sweep(&camera, 24, 0.4, 0.05, 1.5, 8);
    let found = calibrate_intrinsics(&bent, size, &IntrinsicsOptions::default()).unwrap();
    let bend = found.report.bend_mm.expect("a bent board is seen to be");
    assert!((bend[0].abs() - 1.5).abs() < 0.2 && bend[1].abs() < 0.2, "{bend:?}");
    assert!((found.camera.fx - camera.fx).abs() < 1e-3 * camera.fx, "{}", found.camera.fx);
    assert!(found.report.advice.iter().any(|a| a.contains("bent")));
}

/// A board, larger than described by `scale`, that moves along a stage, at angles that change by `tilt`.
fn staged(camera: &Camera, step_mm: f64, scale: f64, tilt: f64) -> Vec<View> {
    let mut rng = Gauss::new(11);
    let pose = |i: usize, rng: &mut Gauss| {
        let turn = Vector3::new(0.02 + tilt * rng.next(), -0.03 + tilt * rng.next(), 0.01);
        let at = Vector3::new(3.0 + 0.01 * i as f64, -2.0, 350.0 + step_mm * i as f64);
        // A larger board looks as one of the described size does that is nearer.
        Isometry3::from_parts(Translation3::from(at / scale), UnitQuaternion::from_scaled_axis(turn))
    };
    let mut drawn = Vec::new();
    for i in 0..24 {
        let pose = pose(i, &mut rng);
        drawn.push(view(camera, &pose, 0.03, 0.0, i, &mut rng));
    }
    drawn
}

#[test]
fn boards_that_face_the_camera_are_refused() {
    let (_, camera) = cameras().swap_remove(1);
    let size = [camera.width, camera.height];
    let views = staged(&camera, 6.0, 1.0, 0.0);
    let error = calibrate_intrinsics(&views, size, &IntrinsicsOptions::default()).unwrap_err();
    eprintln!("{error}");
    assert!(matches!(error, IntrinsicsError::FocalLength { .. }), "{error}");
    assert!(error.to_string().contains("face the camera") && !error.to_string().contains('\n'));

    // A stage's step nearly fixes the focal length, but not where the stage points: a shift of the picture looks the same.
    let stage = Some(StageStep { step_mm: 6.0, sigma_mm: 0.02 });
    let options = IntrinsicsOptions { stage, ..IntrinsicsOptions::default() };
    let error = calibrate_intrinsics(&views, size, &options).unwrap_err();
    let open = matches!(error, IntrinsicsError::PrincipalPoint { .. } | IntrinsicsError::FocalLength { .. });
    assert!(open, "{error}");
    let options = IntrinsicsOptions { keep_uncertain: true, ..options };
    let found = calibrate_intrinsics(&views, size, &options).unwrap();
    assert!((found.camera.fx - camera.fx).abs() < 0.01 * camera.fx, "{}", found.camera.fx);
    assert!(found.report.pinhole_sigma_px[2] > 6.0 && found.report.advice[0].contains("cannot be determined"));
}

#[test]
fn the_step_of_a_stage_fixes_the_scale() {
    let (_, camera) = cameras().swap_remove(1);
    let size = [camera.width, camera.height];
    let views = staged(&camera, 6.0, 1.003, 0.3);
    let stage = Some(StageStep { step_mm: 6.0, sigma_mm: 0.02 });
    let options = IntrinsicsOptions { stage, ..IntrinsicsOptions::default() };
    let found = calibrate_intrinsics(&views, size, &options).unwrap();
    let [scale, sigma] = found.report.board_scale.unwrap();
    eprintln!("f {} ± {}, scale {scale} ± {sigma}", found.camera.fx, found.report.pinhole_sigma_px[0]);
    assert!((found.camera.fx - camera.fx).abs() < 1e-3 * camera.fx, "{}", found.camera.fx);
    assert!((scale - 1.003).abs() < (4.0 * sigma).min(1e-3), "{scale} ± {sigma}");
}

#[test]
fn few_views_and_foreign_corners_are_refused() {
    let (_, camera) = cameras().swap_remove(0);
    let size = [camera.width, camera.height];
    let few = |n| calibrate_intrinsics(&sweep(&camera, n, 0.4, 0.05, 0.0, 3), size, &IntrinsicsOptions::default());
    assert!(matches!(few(0).unwrap_err(), IntrinsicsError::TooFewViews { usable: 0, .. }));
    assert!(matches!(few(2).unwrap_err(), IntrinsicsError::TooFewViews { usable: 2, .. }));
    // Corners on one line, and corners that are noise, end in an error and not in a camera.
    let mut rng = Gauss::new(2);
    for line in [true, false] {
        let corner = |i: usize, rng: &mut Gauss| Corner {
            board_mm: [i as f64, if line { 0.0 } else { 100.0 * rng.uniform() }],
            px: [640.0 * rng.uniform(), 480.0 * rng.uniform()],
        };
        let views: Vec<View> = (0..8)
            .map(|n| View { name: n.to_string(), number: n, corners: (0..30).map(|i| corner(i, &mut rng)).collect() })
            .collect();
        assert!(calibrate_intrinsics(&views, size, &IntrinsicsOptions::default()).is_err());
    }
}

/// Real boards, five of them: each is left out in turn, and judged by the camera of the other four. With
/// NELU3D_CORNERS=FILE the corners are written there for other programs.
#[test]
fn real_boards_predict_the_one_that_was_left_out() {
    let dir = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/kamino");
    if !dir.is_dir() {
        eprintln!("SKIPPED: {} is not there: cameras are not calibrated from real boards", dir.display());
        return;
    }
    let rig = nelu3d_scan::Rig::open_uncalibrated(&dir).unwrap();
    let detector = nelu3d_scan::board::Detector::new(rig.board.as_ref().unwrap()).unwrap();
    let shots = rig.positions().unwrap();
    let load = |i: usize| {
        let image = rig.read_image(&shots[i].dir.join(&rig.white))?;
        Ok::<_, nelu3d_scan::rig::RigError>(GrayImage {
            width: image.width,
            height: image.height,
            data: image.to_gray().into_owned(),
        })
    };
    let size = [rig.camera.width, rig.camera.height];
    let views = |found: Vec<Result<Vec<Corner>, String>>| -> Vec<View> {
        let of = |(i, corners): (usize, Result<Vec<Corner>, String>)| View {
            name: shots[i].name.clone(),
            number: i,
            corners: corners.unwrap(),
        };
        found.into_iter().enumerate().map(of).collect()
    };
    let options = IntrinsicsOptions { keep_uncertain: true, ..IntrinsicsOptions::default() };
    let rough = views(find_boards(&detector, shots.len(), load, |_| true).unwrap().unwrap());
    let first = calibrate_intrinsics(&rough, size, &options).unwrap();
    let detector = detector.with_camera(&first.camera);
    let all = views(find_boards(&detector, shots.len(), load, |_| true).unwrap().unwrap());
    if let Ok(file) = std::env::var("NELU3D_CORNERS") {
        let rows = |v: &View| v.corners.iter().map(|c| [c.board_mm, c.px].concat()).collect::<Vec<_>>();
        let named: std::collections::BTreeMap<_, _> = all.iter().map(|v| (v.name.clone(), rows(v))).collect();
        std::fs::write(file, serde_json::to_string(&named).unwrap()).unwrap();
    }
    for left in 0..all.len() {
        let others: Vec<View> = all.iter().enumerate().filter(|(i, _)| *i != left).map(|(_, v)| v.clone()).collect();
        let found = calibrate_intrinsics(&others, size, &options).unwrap();
        let pose = nelu3d_scan::pose::solve_pnp(&all[left].corners, &found.camera).unwrap();
        let (r, c) = (&found.report, &found.camera);
        eprintln!(
            "without {}: {} coefficients {:?}, f {:.1} ± {:.1}, center {:.1} ± {:.1}, {:.1} ± {:.1}, left out {:.4} px",
            all[left].name,
            r.coefficients,
            c.distortion.coeffs(),
            c.fx,
            r.pinhole_sigma_px[0],
            c.cx,
            r.pinhole_sigma_px[2],
            c.cy,
            r.pinhole_sigma_px[3],
            pose.rms_px
        );
        assert!(pose.rms_px < 0.3, "{}: {}", all[left].name, pose.rms_px);
    }
}
