use nalgebra::{Matrix3, Vector3};
use nelu3d::sensor::{CrosstalkCorrection, CrosstalkMatrix};

const A: CrosstalkMatrix = CrosstalkMatrix([[0.83, 0.14, 0.03], [0.10, 0.78, 0.12], [0.02, 0.17, 0.81]]);

#[test]
fn back_is_the_inverse_of_forth() {
    let correction = CrosstalkCorrection::new(&A).unwrap();
    for white in [[0.9, 0.2, 0.1], [0.3, 0.3, 0.3], [0.1, 0.15, 0.6]] {
        let white = A.matrix() * Vector3::from(white);
        let identity = correction.board_from_object(white) * correction.object_from_board(white);
        assert!((identity - Matrix3::identity()).abs().max() < 1e-4, "{identity}");
        // White stays white: rows sum to one.
        assert!((correction.object_from_board(white) * Vector3::repeat(1.0) - Vector3::repeat(1.0)).abs().max() < 1e-5);
    }
}

/// A gray object is measured as the board is, whatever the crosstalk.
#[test]
fn gray_objects_have_no_crosstalk() {
    let correction = CrosstalkCorrection::new(&A).unwrap();
    assert!((correction.object_from_board(Vector3::repeat(0.4)) - Matrix3::identity()).abs().max() < 1e-5);
}

/// The formula agrees with the physics that it stands for: patterns through the object's color fractions and A.
#[test]
fn a_colored_object_measures_what_the_model_says() {
    let (rho, patterns) = (Vector3::new(0.8f32, 0.3, 0.1), Vector3::new(0.2f32, 0.7, 0.5));
    let a = A.matrix();
    let measured = (a * rho.component_mul(&patterns)).component_div(&(a * rho));
    let found = CrosstalkCorrection::new(&A).unwrap().object_from_board(a * rho) * (a * patterns);
    assert!((measured - found).abs().max() < 1e-5, "{measured} {found}");
}
