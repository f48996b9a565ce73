//! Poses to start from that need no features: principal axes in all ways, and rotations all over.

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand::rngs::StdRng;
use rand_distr::{Distribution, StandardNormal};

use super::sample::OrientedPoint;

/// Returns the 24 ways to lay the principal axes of `model` on those of `scan`.
///
/// A scan sees one side, so moments are compared with those of the part that faces the camera, which depends on the
/// pose: centers come from [`centered`], and all axes are tried in all orders.
pub(super) fn by_moments(model: &[OrientedPoint], scan: &[OrientedPoint]) -> Vec<Isometry3<f64>> {
    let (ours, theirs) = (axes(model), axes(scan));
    let mut poses = Vec::with_capacity(24);
    for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]] {
        for signs in 0..4 {
            let sign = |bit: u32| if signs >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let (x, y) = (ours.column(order[0]) * sign(0), ours.column(order[1]) * sign(1));
            let from = Matrix3::from_columns(&[x, y, x.cross(&y)]);
            let (x, y) = (theirs.column(0).into_owned(), theirs.column(1).into_owned());
            let to = Matrix3::from_columns(&[x, y, x.cross(&y)]);
            let rotation = Rotation3::from_matrix_unchecked(to * from.transpose());
            poses.push(centered(model, scan, &UnitQuaternion::from_rotation_matrix(&rotation)));
        }
    }
    poses
}

/// Returns poses with `n` rotations, spread evenly at random.
pub(super) fn all_over(model: &[OrientedPoint], scan: &[OrientedPoint], n: usize, seed: u64) -> Vec<Isometry3<f64>> {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    (0..n)
        .map(|_| UnitQuaternion::new_normalize(Quaternion::new(normal(), normal(), normal(), normal())))
        .map(|rotation| centered(model, scan, &rotation))
        .collect()
}

/// Returns the pose with this rotation that lays the center of what would face the camera onto the center of the scan.
fn centered(model: &[OrientedPoint], scan: &[OrientedPoint], rotation: &UnitQuaternion<f64>) -> Isometry3<f64> {
    let center = mean(scan.iter().map(|s| s.point));
    let view = center.coords.normalize();
    let facing = model.iter().filter(|m| (rotation * m.normal).dot(&view) < 0.0).map(|m| m.point);
    let of_model = if facing.clone().next().is_some() { mean(facing) } else { mean(model.iter().map(|m| m.point)) };
    Isometry3::from_parts((center - rotation * of_model).into(), *rotation)
}

/// Returns the mean of some points.
fn mean(points: impl Iterator<Item = Point3<f64>>) -> Point3<f64> {
    let (sum, n) = points.fold((Vector3::zeros(), 0.0), |(sum, n), p| (sum + p.coords, n + 1.0));
    Point3::from(sum / n)
}

/// Returns the principal axes, largest spread first.
fn axes(points: &[OrientedPoint]) -> Matrix3<f64> {
    let center = mean(points.iter().map(|o| o.point));
    let spread = points.iter().fold(Matrix3::zeros(), |m, o| {
        let d = o.point - center;
        m + d * d.transpose()
    });
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    Matrix3::from_columns(&order.map(|i| eigen.eigenvectors.column(i).into_owned()))
}
