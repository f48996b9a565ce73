use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_baselines::projector::{Lens, Sample, fit};
use nelu3d_scan::camera::Distortion;
use nelu3d_scan::{Camera, Projector};

fn truth() -> Projector {
    let distortion = Distortion::new(&[-0.03, 0.02, 4e-4, -3e-4]).unwrap();
    Projector {
        optics: Camera { distortion, ..Camera::pinhole(640, 400, 1250.0, 1247.0, 322.0, 203.0) },
        proj_from_cam: Isometry3::new(Vector3::new(-180.0, 20.0, 30.0), Vector3::new(0.02, 0.27, -0.01)),
    }
}

/// Corners of boards of one angle at several depths, as on a stage.
fn samples(depths: &[f64]) -> Vec<Sample> {
    let truth = truth();
    let mut out = Vec::new();
    for z in depths {
        for i in 0..8 {
            for j in 0..6 {
                let (x, y) = (25.0 * f64::from(i) - 90.0, 24.0 * f64::from(j) - 60.0);
                let point = Point3::new(x, y, z + 0.05 * x);
                out.push(Sample { point, px: truth.project(&point).unwrap() });
            }
        }
    }
    out
}

#[test]
fn a_projector_comes_back_with_outliers_and_from_parallel_boards() {
    let mut seen = samples(&[630.0, 670.0, 710.0, 770.0]);
    for k in [3, 50, 120] {
        seen[k].px[0] += 7.0;
    }
    let fitted = fit(&seen, [640, 400], Lens::Full).unwrap();
    assert_eq!(fitted.rejected, 3);
    assert!(fitted.rms_px < 1e-4, "{}", fitted.rms_px);
    assert!((fitted.projector.center() - truth().center()).norm() < 0.01);
    for s in samples(&[600.0, 800.0]) {
        let px = fitted.projector.project(&s.point).unwrap();
        assert!((px[0] - s.px[0]).hypot(px[1] - s.px[1]) < 0.01);
    }
    // Without distortion it cannot be as good.
    assert!(fit(&seen, [640, 400], Lens::None).unwrap().rms_px > 0.01);
}

#[test]
fn one_plane_does_not_determine_a_projector() {
    assert!(fit(&samples(&[700.0]), [640, 400], Lens::Full).is_none());
}
