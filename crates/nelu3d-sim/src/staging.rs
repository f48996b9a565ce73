//! What stands where while a scene is taken, in the frame of the camera as it stands then.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::scene::{PrintedBoard, VirtualScene};
use crate::spec::{LightSpec, SceneSpec, Spec, SpecError};
use crate::sweep::sweep_poses;

/// Returns the objects of a scene of a checked spec, and the board where it has one.
///
/// # Errors
///
/// A file that an object names cannot be read (any more).
pub(crate) fn stage(spec: &Spec, scene: &SceneSpec, board: &PrintedBoard) -> Result<VirtualScene, SpecError> {
    let mut staged = VirtualScene::new(&scene.objects)?;
    if let Some(position) = &scene.board {
        let pose = sweep_poses(spec).into_iter().find(|p| p.position == *position).expect("checked with the spec");
        staged.add(VirtualScene::of_board(board, &pose.cam_from_board, &[]));
    }
    staged.move_by(&camera_motion(spec, scene));
    Ok(staged)
}

/// Returns how the light source moved in the camera's frame since the sweep.
pub(crate) fn light_motion(spec: &Spec, scene: &SceneSpec) -> Isometry3<f64> {
    let (position, target) = match &spec.light {
        LightSpec::Projector(p) => (p.position_mm, p.target_mm),
        LightSpec::Film(f) => (f.position_mm, f.target_mm),
    };
    let center = Translation3::from(Vector3::from(position));
    let [dx, dy] = scene.bump.map_or([0.0; 2], |b| b.light_px);
    let axis = Vector3::from(target) - Vector3::from(position);
    let shift = Vector3::new(dx * target[2] / spec.camera.fx, dy * target[2] / spec.camera.fy, 0.0);
    camera_motion(spec, scene) * center * turn(&axis, &shift) * center.inverse()
}

/// Returns how all that stands still moved in the frame of a camera that was bumped since the sweep.
fn camera_motion(spec: &Spec, scene: &SceneSpec) -> Isometry3<f64> {
    let [dx, dy] = scene.bump.map_or([0.0; 2], |b| b.camera_px);
    let shift = Vector3::new(dx / spec.camera.fx, dy / spec.camera.fy, 0.0);
    Isometry3::from_parts(Translation3::identity(), turn(&Vector3::z(), &shift))
}

/// Returns the smallest turn that moves the end of `arm` by `shift`, up to what `shift` has along it.
fn turn(arm: &Vector3<f64>, shift: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(arm.cross(shift) / arm.norm_squared())
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::spec::BumpSpec;

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
}
