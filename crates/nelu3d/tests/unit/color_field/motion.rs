use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use nelu3d::color_field::LightMotion;

#[test]
fn it_turns_about_its_point() {
    let about = Point3::new(0.0, 5.0, 700.0);
    let motion = LightMotion {
        rotation: [0.01, -0.02, 0.03],
        translation_mm: [1.0, 2.0, -3.0],
        ..LightMotion::none(about.coords.into())
    };
    assert!((motion.isometry() * about - (about + Vector3::new(1.0, 2.0, -3.0))).norm() < 1e-9);
    let (a, b) = (Point3::new(30.0, -20.0, 650.0), Point3::new(31.0, -20.0, 650.0));
    let turned = UnitQuaternion::from_scaled_axis(Vector3::new(0.01, -0.02, 0.03)) * (b - a);
    assert!((motion.isometry() * b - motion.isometry() * a - turned).norm() < 1e-9);
    assert_eq!(LightMotion::none([1.0, 2.0, 3.0]).isometry(), Isometry3::identity());
}
