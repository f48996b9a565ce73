//! Ray against triangle, after Woop, Benthin and Wald (Watertight Ray/Triangle Intersection, JCGT 2(1), 2013): seen
//! along the ray, an edge passes on the same side for both triangles that share it, to the last bit.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Ray;

/// The map that takes a ray to the unit vector z from the origin, which all intersections of the ray share.
pub struct Shear {
    origin: Point3<f64>,
    axes: [usize; 3],
    shear: [f64; 3],
}

impl Shear {
    /// Returns the map of a ray.
    pub fn new(ray: &Ray) -> Self {
        let z = ray.dir.iamax();
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        // The winding stays.
        if ray.dir[z] < 0.0 {
            (x, y) = (y, x);
        }
        let d = &ray.dir;
        Self { origin: ray.origin, axes: [x, y, z], shear: [d[x] / d[z], d[y] / d[z], 1.0 / d[z]] }
    }

    /// Returns the distance along the ray, above 0, at which it meets a triangle, and the weights of the triangle's
    /// corners there; `None` if it does not.
    #[inline]
    pub fn hit(&self, corners: [&Point3<f64>; 3]) -> Option<(f64, [f64; 3])> {
        let ([x, y, z], s) = (self.axes, self.shear);
        let local: [Vector3<f64>; 3] = corners.map(|p| p - self.origin);
        let [a, b, c] = local.map(|p| [p[x] - s[0] * p[z], p[y] - s[1] * p[z]]);
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let sum = u + v + w;
        if sum == 0.0 {
            return None;
        }
        let [u, v, w] = [u / sum, v / sum, w / sum];
        let t = s[2] * (u * local[0][z] + v * local[1][z] + w * local[2][z]);
        (t > 0.0).then_some((t, [u, v, w]))
    }
}
