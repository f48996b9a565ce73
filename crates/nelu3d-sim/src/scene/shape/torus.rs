//! A ring about the y axis. A ray meets it where a quartic polynomial is zero.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};
use nelu3d_scan::{Mesh, Ray};

use super::roots::first_root;
use crate::scene::tessellation::{N_RINGS, N_SEGMENTS, revolve};

/// A ring about the y axis.
#[derive(Clone, Copy, Debug)]
pub struct Torus {
    /// Radius of the ring's middle line, mm.
    pub major: f64,
    /// Radius of its cross section, mm.
    pub minor: f64,
}

impl Torus {
    pub(super) fn hit(&self, ray: &Ray, limit: f64) -> Option<(f64, Vector3<f64>)> {
        // Within the ball about it; s counts from where the ray enters that, so that numbers stay small.
        let reach = self.major + self.minor;
        let middle = -ray.origin.coords.dot(&ray.dir);
        let room = reach * reach * (1.0 + 1e-9) - (ray.origin.coords + ray.dir * middle).norm_squared();
        if room < 0.0 {
            return None;
        }
        let (start, end) = ((middle - room.sqrt()).max(0.0), (middle + room.sqrt()).min(limit));
        if start >= end {
            return None;
        }
        let o = ray.at(start);
        // (|p|² + R² − r²)² = 4 R² (x² + z²), with p = o + s d.
        let [k0, k1] =
            [o.coords.norm_squared() + self.major.powi(2) - self.minor.powi(2), 2.0 * o.coords.dot(&ray.dir)];
        let four = 4.0 * self.major * self.major;
        let poly = [
            k0 * k0 - four * (o.x * o.x + o.z * o.z),
            2.0 * k0 * k1 - 2.0 * four * (o.x * ray.dir.x + o.z * ray.dir.z),
            2.0 * k0 + k1 * k1 - four * (ray.dir.x * ray.dir.x + ray.dir.z * ray.dir.z),
            2.0 * k1,
            1.0,
        ];
        let s = first_root(&poly, end - start)?;
        let t = start + s;
        (t > 0.0 && t < limit).then(|| (t, self.normal(&ray.at(t))))
    }

    /// Returns the unit normal: away from the nearest point of the ring's middle line.
    fn normal(&self, p: &Point3<f64>) -> Vector3<f64> {
        let axis_distance = p.x.hypot(p.z);
        let part = 1.0 - self.major / axis_distance;
        Vector3::new(p.x * part, p.y, p.z * part).normalize()
    }

    pub(super) fn mesh(&self) -> Mesh {
        let mut mesh = revolve(|i| {
            let (s, c) = (TAU * i as f64 / N_RINGS as f64).sin_cos();
            // From the outside downward and around: rings climb there as on the other forms.
            [-self.minor * s, self.major + self.minor * c, -s, c]
        });
        // The last ring is the first again.
        let last = (N_RINGS * N_SEGMENTS) as u32;
        mesh.vertices.truncate(last as usize);
        mesh.normals.truncate(last as usize);
        mesh.faces.iter_mut().flatten().for_each(|i| *i %= last);
        mesh
    }
}
