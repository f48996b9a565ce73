mod distortion;
mod file;

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Camera;
use nelu3d_scan::camera::Distortion;

#[test]
fn a_binned_camera_sees_a_point_in_the_same_place() {
    let coeffs = [-0.2, 0.1, 1e-3, -2e-3];
    let camera = Camera {
        distortion: Distortion::new(&coeffs).unwrap(),
        ..Camera::pinhole(640, 480, 700.0, 690.0, 321.0, 238.0)
    };
    let point = Point3::new(60.0, -35.0, 400.0);
    let (fine, coarse) = (camera.project(&point).unwrap(), camera.binned(3).project(&point).unwrap());
    assert!((0..2).all(|i| (3.0 * (coarse[i] + 0.5) - 0.5 - fine[i]).abs() < 1e-9), "{fine:?} {coarse:?}");
}

#[test]
fn projections_have_the_derivatives_of_differences() {
    let mut camera = Camera::pinhole(640, 480, 900.0, 910.0, 300.0, 250.0);
    camera.distortion = Distortion::new(&[-0.2, 0.1, 1e-3, -2e-3, 0.02]).expect("five coefficients");
    for p in [Point3::new(0.0, 0.0, 700.0), Point3::new(120.0, -90.0, 600.0), Point3::new(-200.0, 130.0, 900.0)] {
        let (px, j) = camera.project_with_jacobian(&p).expect("before the camera");
        assert_eq!(Some(px), camera.project(&p));
        for i in 0..3 {
            let mut h = Vector3::zeros();
            h[i] = 1e-3;
            let (a, b) = (camera.project(&(p + h)).unwrap(), camera.project(&(p - h)).unwrap());
            for row in 0..2 {
                let slope = (a[row] - b[row]) / 2e-3;
                assert!((slope - j[(row, i)]).abs() < 1e-7, "{p} {row} {i}: {slope} {}", j[(row, i)]);
            }
        }
    }
    assert!(camera.project_with_jacobian(&Point3::new(0.0, 0.0, -1.0)).is_none());
}
