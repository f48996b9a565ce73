//! Poses of a board that is held by hand.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use nelu3d_scan::camera::Camera;
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_distr::{Distribution, StandardNormal};

use crate::random::{RandomPurpose, generator};
use crate::spec::{DepthSpacing, Spec, SweepSpec};

/// Draws of one position before it is given up.
const MAX_DRAWS: usize = 1000;

/// Points along x and along y at which is tested whether the board is in the picture.
const VIEW_GRID: usize = 24;

/// Coordinate of the random numbers that order the depths; no position has this index.
const ORDER: u64 = u64::MAX;

/// Returns the pose of the board's middle at every position of a hand-held sweep.
///
/// # Errors
///
/// The index of the first position at which no pose keeps to `max_tilt` and `min_in_view`.
///
/// # Panics
///
/// If the sweep is none by hand, or the camera's values make no sense.
pub fn handheld_poses(spec: &Spec) -> Result<Vec<Isometry3<f64>>, usize> {
    let SweepSpec::Handheld { positions, depths, .. } = spec.sweep else { unreachable!("a sweep by hand") };
    let mut slots: Vec<usize> = (0..positions).collect();
    if depths == DepthSpacing::Scattered {
        slots.shuffle(&mut generator(spec.seed, RandomPurpose::Sweep, [ORDER, 0, 0]));
    }
    let camera = spec.camera.optics().expect("checked with the spec");
    slots.iter().enumerate().map(|(i, slot)| position(spec, &camera, i, *slot).ok_or(i)).collect()
}

/// Draws poses of position `i` until one keeps to the rules; `slot` is its part of the depths.
fn position(spec: &Spec, camera: &Camera, i: usize, slot: usize) -> Option<Isometry3<f64>> {
    let SweepSpec::Handheld {
        positions,
        first_mm,
        last_mm,
        center_mm,
        position_sigma_mm,
        tilt_sigma,
        depths,
        max_tilt,
        min_in_view,
        ..
    } = spec.sweep
    else {
        unreachable!("a sweep by hand")
    };
    let mut random = generator(spec.seed, RandomPurpose::Sweep, [i as u64, 0, 0]);
    // Numbers of their own, so that the spacing leaves all others as they are.
    let mut random_depth = generator(spec.seed, RandomPurpose::Sweep, [i as u64, 1, 0]);
    (0..MAX_DRAWS).find_map(|_| {
        let part = match depths {
            DepthSpacing::Even => slot as f64 / (positions - 1) as f64,
            DepthSpacing::Scattered => (slot as f64 + random_depth.random::<f64>()) / positions as f64,
        };
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let jitter = Vector3::from_fn(|_, _| position_sigma_mm * normal());
        let at = Vector3::new(center_mm[0], center_mm[1], first_mm + (last_mm - first_mm) * part) + jitter;
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from([0, 1, 2].map(|_| tilt_sigma * normal())));
        let pose = Isometry3::from_parts(Translation3::from(at), rotation);
        let good = max_tilt.is_none_or(|limit| tilt(&pose) <= limit)
            && (min_in_view == 0.0 || fraction_in_view(spec, camera, &pose) >= min_in_view);
        good.then_some(pose)
    })
}

/// Returns the angle between the normal of a board at a pose and the camera's axis, radians.
pub fn tilt(pose: &Isometry3<f64>) -> f64 {
    (pose.rotation * Vector3::z()).angle(&Vector3::z())
}

/// Returns the fraction of the area of the spec's board that projects into the picture of a camera, the board's middle
/// being at a pose.
pub fn fraction_in_view(spec: &Spec, camera: &Camera, cam_from_middle: &Isometry3<f64>) -> f64 {
    let [x0, y0, x1, y1] = spec.board.extent_mm();
    let at = |i: usize, side: f64| ((i as f64 + 0.5) / VIEW_GRID as f64 - 0.5) * side;
    let seen = (0..VIEW_GRID * VIEW_GRID).filter(|i| {
        let p = cam_from_middle * Point3::new(at(i % VIEW_GRID, x1 - x0), at(i / VIEW_GRID, y1 - y0), 0.0);
        let px = if p.z > 0.0 { camera.project(&p) } else { None };
        px.is_some_and(|[x, y]| {
            x >= -0.5 && y >= -0.5 && x <= camera.width as f64 - 0.5 && y <= camera.height as f64 - 0.5
        })
    });
    seen.count() as f64 / (VIEW_GRID * VIEW_GRID) as f64
}
