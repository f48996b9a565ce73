//! Where the hands that hold the board are.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;

use crate::random::{RandomPurpose, generator};
use crate::scene::Hand;
use crate::spec::{Spec, SweepSpec};

/// Largest angle between a thumb and the normal of the board's outline, radians.
const MAX_SKEW: f64 = 0.6;

/// Returns the hands at a position of the sweep: anywhere on the board's outline, evenly around it, thumbs inward.
pub(crate) fn hands_at(spec: &Spec, position: usize) -> Vec<Hand> {
    let SweepSpec::Handheld { hands: Some(hands), .. } = &spec.sweep else { return Vec::new() };
    let mut random = generator(spec.seed, RandomPurpose::Sweep, [position as u64, 2, 0]);
    let start: f64 = random.random();
    (0..hands.number)
        .map(|i| {
            let skew = MAX_SKEW * (2.0 * random.random::<f64>() - 1.0);
            let (at, inward) = on_outline(spec.board.extent_mm(), start + i as f64 / hands.number as f64);
            let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), inward + skew);
            let board_from_hand = Isometry3::from_parts(Translation3::new(at[0], at[1], 0.0), rotation);
            Hand { board_from_hand, size_mm: hands.size_mm, albedo: hands.albedo }
        })
        .collect()
}

/// Returns the point after a part of the outline of a board of extent `[x0, y0, x1, y1]`, mm (whole turns do not
/// count), and the angle about z that turns y inward, radians.
pub fn on_outline([x0, y0, x1, y1]: [f64; 4], part: f64) -> ([f64; 2], f64) {
    let (width, height) = (x1 - x0, y1 - y0);
    let along = part.rem_euclid(1.0) * 2.0 * (width + height);
    if along < width {
        ([x0 + along, y0], 0.0)
    } else if along < width + height {
        ([x1, y0 + (along - width)], 0.5 * PI)
    } else if along < 2.0 * width + height {
        ([x1 - (along - width - height), y1], PI)
    } else {
        ([x0, y1 - (along - 2.0 * width - height)], -0.5 * PI)
    }
}
