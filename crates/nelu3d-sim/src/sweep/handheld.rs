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
pub(super) fn handheld_poses(spec: &Spec) -> Result<Vec<Isometry3<f64>>, usize> {
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

/// Returns the angle between the board's normal and the camera's axis, radians.
fn tilt(pose: &Isometry3<f64>) -> f64 {
    (pose.rotation * Vector3::z()).angle(&Vector3::z())
}

/// Returns the fraction of the board's area that projects into the picture.
fn fraction_in_view(spec: &Spec, camera: &Camera, cam_from_middle: &Isometry3<f64>) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep(seed: u64, depths: DepthSpacing, max_tilt: Option<f64>, min_in_view: f64) -> Spec {
        let sweep = SweepSpec::Handheld {
            positions: 40,
            first_mm: 500.0,
            last_mm: 900.0,
            center_mm: [0.0; 2],
            position_sigma_mm: 30.0,
            tilt_sigma: 0.4,
            depths,
            max_tilt,
            min_in_view,
            hands: None,
            write_poses: true,
        };
        Spec { seed, sweep, ..Spec::preset("demo").unwrap() }
    }

    #[test]
    fn tilts_keep_to_their_limit_and_come_near_it() {
        let limit = 40f64.to_radians();
        let free = handheld_poses(&sweep(1, DepthSpacing::Even, None, 0.0)).unwrap();
        let bound = handheld_poses(&sweep(1, DepthSpacing::Even, Some(limit), 0.0)).unwrap();
        let largest = |poses: &[Isometry3<f64>]| poses.iter().map(tilt).fold(0.0, f64::max);
        assert!(largest(&free) > limit, "{}", largest(&free));
        assert!((0.8 * limit..=limit).contains(&largest(&bound)), "{}", largest(&bound));
        // Poses within the limit stay what they are without it.
        for (a, b) in free.iter().zip(&bound).filter(|(a, _)| tilt(a) <= limit) {
            assert_eq!(a, b);
        }
    }

    #[test]
    fn boards_leave_the_picture_as_far_as_they_may() {
        let spec = sweep(2, DepthSpacing::Even, None, 0.6);
        let camera = spec.camera.optics().unwrap();
        let shares: Vec<f64> =
            handheld_poses(&spec).unwrap().iter().map(|p| fraction_in_view(&spec, &camera, p)).collect();
        assert!(shares.iter().all(|s| *s >= 0.6), "{shares:?}");
        assert!(shares.iter().any(|s| *s < 0.8), "{shares:?}");
        // A board of 200 × 160 mm that fills four times the picture's area: 900 px over 160 mm are 320 × 240 px.
        let near = Isometry3::translation(0.0, 0.0, 450.0);
        let share = fraction_in_view(&spec, &camera, &near);
        assert!((share - 320.0 * 240.0 / (400.0 * 320.0)).abs() < 0.05, "{share}");
    }

    #[test]
    fn scattered_depths_have_one_position_in_every_part_in_an_order_of_the_seed() {
        let slots = |seed| {
            let mut spec = sweep(seed, DepthSpacing::Scattered, None, 0.0);
            if let SweepSpec::Handheld { position_sigma_mm, .. } = &mut spec.sweep {
                *position_sigma_mm = 0.0;
            }
            let poses = handheld_poses(&spec).unwrap();
            poses.iter().map(|p| ((p.translation.z - 500.0) / 10.0) as usize).collect::<Vec<_>>()
        };
        let (a, b) = (slots(3), slots(4));
        assert_eq!(a, slots(3));
        assert_ne!(a, b);
        let mut sorted = a;
        sorted.sort_unstable();
        assert_eq!(sorted, (0..40).collect::<Vec<_>>());
    }

    #[test]
    fn rules_that_nothing_keeps_are_errors() {
        let mut spec = sweep(5, DepthSpacing::Even, None, 1.0);
        let SweepSpec::Handheld { first_mm, .. } = &mut spec.sweep else { unreachable!("by hand") };
        *first_mm = 300.0;
        assert_eq!(handheld_poses(&spec), Err(0));
        let message = spec.check().unwrap_err().to_string();
        assert!(message.contains("sweep.min_in_view"), "{message}");
    }
}
