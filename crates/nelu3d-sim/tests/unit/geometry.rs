use nalgebra::Vector3;
use nelu3d_sim::geometry::{orthonormal_basis, power};

#[test]
fn whole_powers_are_powers() {
    for x in [0.0f64, 0.3, 0.97, 1.0] {
        for n in [0.0, 1.0, 2.5, 3.0, 4.0, 17.0] {
            assert!((power(x, n) - x.powf(n)).abs() < 1e-14, "{x}, {n}");
        }
    }
}

#[test]
fn a_basis_is_a_rotation_about_its_normal() {
    for n in [Vector3::z(), -Vector3::z(), Vector3::new(0.4, -0.8, -0.3).normalize()] {
        let m = orthonormal_basis(&n);
        assert!((m * Vector3::z() - n).norm() < 1e-12 && (m.determinant() - 1.0).abs() < 1e-12);
    }
}
