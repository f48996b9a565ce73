//! Poses by voting with point pair features: Drost, Ulrich, Navab and Ilic, "Model globally, match locally: efficient
//! and robust 3D object recognition", CVPR 2010. Made for views from one side, with other things around.

use std::collections::HashMap;
use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::sample::OrientedPoint;

/// Number of bins of a full turn about a normal.
const TURN_BINS: usize = 30;
/// Width of a bin of the angle between two directions, radians (12°).
const ANGLE_STEP: f64 = TAU / 30.0;
/// Number of bins of the distance up to the model's diagonal.
const DISTANCE_BINS: f64 = 20.0;
/// Number of points of the scan that vote.
const VOTERS: usize = 160;
/// Number of pairs that each of them votes with.
const PARTNERS: usize = 500;

/// Quantized feature of a pair of points.
type Key = [u8; 4];

/// Returns poses `scan_from_model`, most votes first, that differ by more than a tenth of `diagonal` or 15°; at most
/// `n`.
pub(super) fn poses(model: &[OrientedPoint], scan: &[OrientedPoint], diagonal: f64, n: usize) -> Vec<Isometry3<f64>> {
    let mut table: HashMap<Key, Vec<(u32, f32)>> = HashMap::new();
    for (i, a) in model.iter().enumerate() {
        let onto_axis = onto_axis(a);
        for (j, b) in model.iter().enumerate() {
            if let Some(key) = key(a, b, diagonal).filter(|_| i != j) {
                table.entry(key).or_default().push((i as u32, turn(&onto_axis, b) as f32));
            }
        }
    }
    let vote = |a: &OrientedPoint| -> Option<(u32, Isometry3<f64>)> {
        let onto_axis_scan = onto_axis(a);
        let mut votes = vec![0u32; model.len() * TURN_BINS];
        let near = scan.iter().filter(|b| (b.point - a.point).norm() <= diagonal);
        for b in near.take(PARTNERS) {
            let Some(entries) = key(a, b, diagonal).and_then(|key| table.get(&key)) else { continue };
            let theirs = turn(&onto_axis_scan, b);
            for &(i, ours) in entries {
                let bin = (theirs - f64::from(ours)).rem_euclid(TAU) / TAU * TURN_BINS as f64;
                votes[i as usize * TURN_BINS + bin as usize % TURN_BINS] += 1;
            }
        }
        // The first of the best, so that the answer does not depend on anything else.
        let (best, &count) = votes.iter().enumerate().max_by_key(|&(i, v)| (v, usize::MAX - i))?;
        let angle = ((best % TURN_BINS) as f64 + 0.5) * TAU / TURN_BINS as f64;
        let about = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle);
        let pose = onto_axis_scan.inverse() * (about * onto_axis(&model[best / TURN_BINS]));
        (count > 0).then_some((count, pose))
    };
    let mut found: Vec<(u32, Isometry3<f64>)> = scan[..scan.len().min(VOTERS)].par_iter().filter_map(vote).collect();
    found.sort_by_key(|f| std::cmp::Reverse(f.0));
    clustered(&found, diagonal, n)
}

/// Groups poses that are near each other: votes add up, and each group is represented by its strongest pose.
fn clustered(found: &[(u32, Isometry3<f64>)], diagonal: f64, n: usize) -> Vec<Isometry3<f64>> {
    let mut groups: Vec<(u32, Isometry3<f64>)> = Vec::new();
    for &(votes, pose) in found {
        let near = |g: &&mut (u32, Isometry3<f64>)| {
            (g.1.translation.vector - pose.translation.vector).norm() < 0.1 * diagonal
                && g.1.rotation.angle_to(&pose.rotation) < 15f64.to_radians()
        };
        match groups.iter_mut().find(near) {
            Some(group) => group.0 += votes,
            None => groups.push((votes, pose)),
        }
    }
    groups.sort_by_key(|g| std::cmp::Reverse(g.0));
    groups.into_iter().take(n).map(|g| g.1).collect()
}

/// Computes the feature of a pair (Section 3.1 of the paper): the distance, and the angles of the two normals against
/// the line between the points, and against each other.
fn key(a: &OrientedPoint, b: &OrientedPoint, diagonal: f64) -> Option<Key> {
    let d = b.point - a.point;
    let length = d.norm();
    if length < 1e-9 * diagonal {
        return None;
    }
    let angle = |u: &Vector3<f64>, v: &Vector3<f64>| (u.angle(v) / ANGLE_STEP) as u8;
    let distance = length / diagonal * DISTANCE_BINS;
    (distance < 255.0)
        .then(|| [distance as u8, angle(&a.normal, &d), angle(&b.normal, &d), angle(&a.normal, &b.normal)])
}

/// Returns the motion of a point into the origin and of its normal onto x.
fn onto_axis(a: &OrientedPoint) -> Isometry3<f64> {
    let half_turn = || UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI);
    let rotation = UnitQuaternion::rotation_between(&a.normal, &Vector3::x()).unwrap_or_else(half_turn);
    Isometry3::from_parts(Translation3::identity(), rotation) * Translation3::from(Point3::origin() - a.point)
}

/// Returns the angle about x at which the other point lies.
fn turn(onto_axis: &Isometry3<f64>, b: &OrientedPoint) -> f64 {
    let p = onto_axis * b.point;
    p.z.atan2(p.y)
}
