use nelu3d::reconstruct::RefineSettings;
use nelu3d::reconstruct::initialize::InitialDepth;
use nelu3d::reconstruct::refine::coarse::{NEAR, Reduced, factor};
use nelu3d_scan::{Camera, Image};

use crate::sensor::measurements::mid_gray;

const STEP: f32 = 1e-5;

/// A slanted plane in the left half of 40 × 30 px, a nearer one in the right half; three columns have no surface.
fn planes() -> InitialDepth {
    let inv_z = (0..1200).map(|i| match i % 40 {
        0..=2 => f32::NAN,
        x if x < 20 => 1e-3 + 0.3 * STEP * x as f32,
        _ => 1.4e-3,
    });
    InitialDepth { inv_z: inv_z.collect(), step: STEP }
}

fn reduced(inv_z: impl Fn(usize, usize) -> f32) -> (Reduced, Vec<f32>) {
    let map: Vec<f32> = (0..300).map(|i| inv_z(i % 20, i / 20)).collect();
    let initial = InitialDepth { inv_z: map.clone(), step: STEP };
    let camera = Camera::pinhole(20, 15, 100.0, 100.0, 10.0, 7.0);
    let measurements = mid_gray(20, 15, 3);
    (Reduced { factor: 2, camera, white: Image::new(20, 15, 1), measurements, initial }, map)
}

#[test]
fn only_large_surfaces_are_refined_in_a_reduced_image() {
    let large = InitialDepth { inv_z: vec![1e-3; 4_000_000], step: STEP };
    let settings = RefineSettings::default();
    assert_eq!(factor(&large, &settings), Some(4));
    assert_eq!(factor(&large, &RefineSettings { fine_steps: 0, ..settings }), None);
    assert_eq!(factor(&planes(), &settings), None);
}

#[test]
fn the_full_image_begins_at_what_was_found_near_by() {
    let initial = planes();
    // Half a step farther on the slanted plane; the column of blocks at the outline is between both.
    let (reduced, found) = reduced(|x, _| match x {
        9 => 1.2e-3,
        x if x < 9 => 1e-3 + 0.3 * STEP * (2.0 * x as f32 + 0.5) - 0.5 * STEP,
        _ => 1.4e-3,
    });
    let start = reduced.start(&found, &initial, 40);
    for (i, (v, before)) in start.inv_z.iter().zip(&initial.inv_z).enumerate() {
        match i % 40 {
            0..=2 => assert!(v.is_nan(), "{i}: no surface becomes none"),
            // Between the middles of blocks that lie on the plane.
            4..=16 => assert!((before - v - 0.5 * STEP).abs() < 0.01 * STEP, "{i}: {v} from {before}"),
            18 | 19 => assert_eq!(v, before, "what lies between two surfaces is on neither"),
            _ => assert!((v - before).abs() <= NEAR * STEP, "{i}: {v} from {before}"),
        }
    }
}
