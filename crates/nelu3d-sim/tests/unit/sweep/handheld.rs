use nalgebra::Isometry3;
use nelu3d_sim::Spec;
use nelu3d_sim::spec::{DepthSpacing, SweepSpec};
use nelu3d_sim::sweep::handheld::{fraction_in_view, handheld_poses, tilt};

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
    let shares: Vec<f64> = handheld_poses(&spec).unwrap().iter().map(|p| fraction_in_view(&spec, &camera, p)).collect();
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
