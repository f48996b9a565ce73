//! Poses and directions.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};

/// Returns the pose, camera from thing, of something at `position` whose z axis points at `target` and whose x axis is
/// level (has no y component). `target` must not lie straight above or below `position`.
pub(crate) fn look_at(position: [f64; 3], target: [f64; 3]) -> Isometry3<f64> {
    let position = Point3::from(position);
    let z = (Point3::from(target) - position).normalize();
    let x = Vector3::y().cross(&z).normalize();
    let y = z.cross(&x);
    let rotation = UnitQuaternion::from_basis_unchecked(&[x, y, z]);
    Isometry3::from_parts(Translation3::from(position), rotation)
}

/// Returns a number `x` from 0 to 1 to the power `n`; whole ones, which lamps and lenses mostly have, by a few
/// products.
pub fn power(x: f64, n: f64) -> f64 {
    if n.fract() == 0.0 && (0.0..=16.0).contains(&n) { x.powi(n as i32) } else { x.powf(n) }
}

/// Returns a rotation that takes z to the unit vector `n`: Duff et al. (Building an Orthonormal Basis, Revisited, JCGT
/// 6(1), 2017).
pub fn orthonormal_basis(n: &Vector3<f64>) -> Matrix3<f64> {
    let sign = 1f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    let t = Vector3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
    let s = Vector3::new(b, sign + n.y * n.y * a, -n.y);
    Matrix3::from_columns(&[t, s, *n])
}

/// Returns a direction about z whose probability density is proportional to its cosine, from two random numbers.
pub(crate) fn sample_cosine([u0, u1]: [f64; 2]) -> Vector3<f64> {
    let (r, phi) = (u0.sqrt(), TAU * u1);
    Vector3::new(r * phi.cos(), r * phi.sin(), (1.0 - u0).sqrt())
}
