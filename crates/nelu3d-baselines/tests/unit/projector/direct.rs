use nalgebra::{Matrix3, Rotation3, Vector3};
use nelu3d_baselines::projector::rq;

#[test]
fn a_matrix_splits_into_triangle_and_rotation() {
    let k = Matrix3::new(1200.0, 3.0, 320.0, 0.0, 1100.0, 200.0, 0.0, 0.0, 1.0);
    let r = Rotation3::from_scaled_axis(Vector3::new(0.3, -0.8, 0.1)).into_inner();
    let (a, b) = rq(&(k * r)).unwrap();
    assert!((a - k).amax() < 1e-9 && (b - r).amax() < 1e-12);
    assert!(rq(&(-k * r)).is_none());
}
