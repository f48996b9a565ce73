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

/// Returns how the light source of a scene moved in the camera's frame since the sweep, mm: with all that stands still
/// ([`camera_motion`]), and by the light's own bump (see [`BumpSpec`](crate::spec::BumpSpec)).
pub fn light_motion(spec: &Spec, scene: &SceneSpec) -> Isometry3<f64> {
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

/// Returns how all that stands still moved in the frame of a camera that was bumped since the sweep, mm; the identity
/// of a scene without a bump.
pub fn camera_motion(spec: &Spec, scene: &SceneSpec) -> Isometry3<f64> {
    let [dx, dy] = scene.bump.map_or([0.0; 2], |b| b.camera_px);
    let shift = Vector3::new(dx / spec.camera.fx, dy / spec.camera.fy, 0.0);
    Isometry3::from_parts(Translation3::identity(), turn(&Vector3::z(), &shift))
}

/// Returns the smallest turn that moves the end of `arm` by `shift`, up to what `shift` has along it.
fn turn(arm: &Vector3<f64>, shift: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(arm.cross(shift) / arm.norm_squared())
}
