use nalgebra::Point3;
use nelu3d_sim::Spec;
use nelu3d_sim::spec::{BumpSpec, LightSpec};
use nelu3d_sim::staging::{camera_motion, light_motion};

/// Where a point that stands still is seen after a bump of the camera, and where the light's axis falls after one
/// of the light.
#[test]
fn a_bump_moves_by_as_many_pixels_as_it_says() {
    let mut spec = Spec::preset("demo").unwrap();
    let bump = |camera_px, light_px| Some(BumpSpec { camera_px, light_px });
    spec.scenes[0].bump = bump([3.0, -1.0], [0.0; 2]);
    let ahead = Point3::new(0.0, 0.0, 700.0);
    let moved = camera_motion(&spec, &spec.scenes[0]) * ahead;
    let px = [moved.x / moved.z * spec.camera.fx, moved.y / moved.z * spec.camera.fy];
    assert!((px[0] - 3.0).abs() < 1e-3 && (px[1] + 1.0).abs() < 1e-3, "{px:?}");
    assert_eq!(light_motion(&spec, &spec.scenes[0]), camera_motion(&spec, &spec.scenes[0]));

    spec.scenes[0].bump = bump([0.0; 2], [2.0, 0.0]);
    let motion = light_motion(&spec, &spec.scenes[0]);
    let LightSpec::Projector(p) = &spec.light else { panic!("demo has a projector") };
    let center = Point3::from(p.position_mm);
    assert!((motion * center - center).norm() < 1e-9);
    let axis = motion * (Point3::from(p.target_mm) - center);
    let falls = center + axis * ((700.0 - center.z) / axis.z);
    let shift = (falls.x - p.target_mm[0]) / 700.0 * spec.camera.fx;
    // The light comes from aside: what moves its axis by 2 px across moves it along z, too.
    assert!((1.8..2.3).contains(&shift), "{shift}");
}
