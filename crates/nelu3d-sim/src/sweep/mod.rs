//! Board poses of a sweep, and the hands that hold the board.

pub mod handheld;
pub mod hands;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use nelu3d_scan::rig::KnownPose;
use rand_distr::{Distribution, StandardNormal};

use crate::random::{RandomPurpose, generator};
use crate::spec::{Spec, SweepSpec};
use handheld::handheld_poses;
pub(crate) use hands::hands_at;

/// Returns the true board poses of a spec's sweep, in order, under the names of their folders.
///
/// # Panics
///
/// If the spec does not pass [`Spec::check`].
pub fn sweep_poses(spec: &Spec) -> Vec<KnownPose> {
    try_sweep_poses(spec).expect("checked with the spec")
}

/// Returns the true board poses of a spec's sweep.
///
/// # Errors
///
/// The index of the first position at which no pose keeps to the sweep's rules.
pub(crate) fn try_sweep_poses(spec: &Spec) -> Result<Vec<KnownPose>, usize> {
    let [x0, y0, x1, y1] = spec.board.extent_mm();
    let middle = Translation3::new(0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0);
    let poses = match &spec.sweep {
        SweepSpec::Stage { .. } => stage_poses(spec),
        SweepSpec::Handheld { .. } => handheld_poses(spec)?,
    };
    let digits = (poses.len() - 1).to_string().len().max(3);
    let named = poses.iter().enumerate().map(|(i, cam_from_middle)| KnownPose {
        position: format!("{i:0digits$}"),
        cam_from_board: cam_from_middle * middle.inverse(),
    });
    Ok(named.collect())
}

/// Returns the pose of the board's middle at every position of a stage.
fn stage_poses(spec: &Spec) -> Vec<Isometry3<f64>> {
    let SweepSpec::Stage {
        positions, first_mm, last_mm, center_mm, slope, rotation, step_error_mm, tilt_jitter, ..
    } = spec.sweep
    else {
        unreachable!("a sweep on a stage")
    };
    let turned = UnitQuaternion::from_scaled_axis(Vector3::from(rotation));
    (0..positions)
        .map(|i| {
            let mut random = generator(spec.seed, RandomPurpose::Sweep, [i as u64, 0, 0]);
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            let part = i as f64 / (positions - 1) as f64;
            let z = first_mm + (last_mm - first_mm) * part + step_error_mm * normal();
            let along = z - 0.5 * (first_mm + last_mm);
            let at = Vector3::new(center_mm[0] + slope[0] * along, center_mm[1] + slope[1] * along, z);
            let wobble = Vector3::from_fn(|_, _| tilt_jitter * normal());
            Isometry3::from_parts(Translation3::from(at), UnitQuaternion::from_scaled_axis(wobble) * turned)
        })
        .collect()
}
