use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use nelu3d_scan::Camera;
use nelu3d_scan::board::Corner;
use nelu3d_scan::camera::Distortion;
use nelu3d_scan::pose::{SharedCause, SharedMisfit, explain_misfit, solve_pnp};

/// What is wrong with a camera, or with a board of 160 × 120 mm.
#[derive(Clone, Copy, Default)]
struct Flaw {
    /// Logarithm of the factor of both focal lengths.
    ln_focal: f64,
    /// Shift of the principal point, px.
    center_px: [f64; 2],
    /// What is missing in k1.
    k1: f64,
    /// Stretch of the print along x, of its length.
    stretch: f64,
    /// How far the left and the right edge stand back behind the middle, mm.
    bend_mm: f64,
}

impl Flaw {
    /// The pixel of a corner.
    fn seen(&self, board_mm: [f64; 2], pose: &Isometry3<f64>, camera: &Camera) -> [f64; 2] {
        let mut coeffs = camera.distortion.coeffs().to_vec();
        coeffs[0] += self.k1;
        let flawed = Camera {
            fx: camera.fx * self.ln_focal.exp(),
            fy: camera.fy * self.ln_focal.exp(),
            cx: camera.cx + self.center_px[0],
            cy: camera.cy + self.center_px[1],
            distortion: Distortion::new(&coeffs).unwrap(),
            ..camera.clone()
        };
        let off = board_mm[0] - 80.0;
        let bent = self.bend_mm * (off / 80.0).powi(2);
        flawed.project(&(pose * Point3::new(board_mm[0] + self.stretch * off, board_mm[1], bent))).unwrap()
    }
}

/// Seven tilted views of a board of 9 × 7 corners as a camera with a flaw sees them, solved by one without.
fn misfit(flaw: Flaw, noise_px: f64) -> SharedMisfit {
    let camera = Camera {
        distortion: Distortion::new(&[-0.1, 0.05, 0.0, 0.0, 0.0]).unwrap(),
        ..Camera::pinhole(640, 480, 900.0, 900.0, 320.0, 240.0)
    };
    let mut state = 1u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        noise_px * ((state >> 33) as f64 / (1u64 << 30) as f64 - 1.0) * 3f64.sqrt()
    };
    let tilts = [[0.3, 0.0], [-0.3, 0.1], [0.0, 0.35], [0.1, -0.3], [0.2, 0.2], [-0.2, -0.2], [0.0, 0.05]];
    let views: Vec<Vec<Corner>> = tilts
        .iter()
        .enumerate()
        .map(|(i, t)| {
            let middle = Vector3::new(10.0 * i as f64 - 30.0, 5.0, 450.0 + 30.0 * i as f64);
            let pose = Isometry3::new(middle, Vector3::new(t[0], t[1], 0.02)) * Translation3::new(-80.0, -60.0, 0.0);
            (0..63)
                .map(|c| {
                    let board_mm = [20.0 * (c % 9) as f64, 20.0 * (c / 9) as f64];
                    let [px, py] = flaw.seen(board_mm, &pose, &camera);
                    Corner { board_mm, px: [px + noise(), py + noise()] }
                })
                .collect()
        })
        .collect();
    let solved: Vec<(&[Corner], Isometry3<f64>)> =
        views.iter().map(|v| (v.as_slice(), solve_pnp(v, &camera).unwrap().cam_from_board)).collect();
    explain_misfit(&solved, &camera).unwrap()
}

#[test]
fn every_cause_has_its_own_pattern() {
    let none = Flaw::default();
    for (cause, flaw, amount) in [
        (SharedCause::Intrinsics, Flaw { ln_focal: 0.05, ..none }, 0.05),
        (SharedCause::Distortion, Flaw { k1: 0.1, ..none }, 0.1),
        (SharedCause::Print, Flaw { stretch: 0.01, ..none }, 0.01),
        (SharedCause::Bend, Flaw { bend_mm: 1.5, ..none }, 1.5),
    ] {
        let found = misfit(flaw, 0.03);
        let best = found.likeliest(|_| true).unwrap();
        assert_eq!(best.cause, cause, "{found:?}");
        assert!(best.share > 0.5 && best.f > 50.0, "{found:?}");
        assert!((best.amount - amount).abs() < 0.3 * amount, "{found:?}");
        assert!(found.rms_explained_px < 0.05 && found.rms_px > 0.05, "{found:?}");
    }
    // A bend of 1.5 mm is 1.5 mm of depth at the edge.
    let found = misfit(Flaw { bend_mm: 1.5, ..none }, 0.03);
    let bend = found.causes.iter().find(|c| c.cause == SharedCause::Bend).unwrap();
    assert!(bend.depth_mm > 0.2 && bend.depth_mm < 1.5, "{bend:?}");
}

/// Far from linear: a focal length and a principal point as of half the resolution.
#[test]
fn a_camera_of_another_resolution_is_no_stretched_print() {
    let found = misfit(Flaw { ln_focal: -0.69, center_px: [-160.0, -120.0], ..Flaw::default() }, 0.03);
    let likeliest = found.likeliest(|e| e.share > 0.3).unwrap();
    assert_eq!(likeliest.cause, SharedCause::Intrinsics, "{found:?}");
    assert!((likeliest.amount - 0.69).abs() < 0.1, "{found:?}");
}

#[test]
fn noise_has_no_cause() {
    let found = misfit(Flaw::default(), 0.1);
    assert!(found.focal_sigma < 0.02, "tilted boards tell the focal length: {found:?}");
    assert!(found.causes.iter().all(|c| c.share < 0.05 && c.f < 10.0), "{found:?}");
    assert!((found.rms_px - 0.14).abs() < 0.02, "{found:?}");
    assert!(explain_misfit(&[], &Camera::pinhole(4, 4, 1.0, 1.0, 2.0, 2.0)).is_none());
}
