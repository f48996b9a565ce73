//! A cylinder about the y axis, closed by discs.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::{Mesh, Ray};

use crate::scene::tessellation::{N_RINGS, close_with_discs, revolve};

/// A cylinder about the y axis, closed by discs.
#[derive(Clone, Copy, Debug)]
pub struct Cylinder {
    /// Radius, mm.
    pub radius: f64,
    /// Half of the distance between the discs, mm.
    pub half_height: f64,
}

impl Cylinder {
    pub(super) fn hit(&self, ray: &Ray, limit: f64) -> Option<(f64, Vector3<f64>)> {
        let (o, d) = (ray.origin, ray.dir);
        // Where the ray is within the endless cylinder, and where between the discs.
        let (mut start, mut end) = (f64::NEG_INFINITY, f64::INFINITY);
        let (mut start_on_disc, mut end_on_disc) = (false, false);
        let a = d.x * d.x + d.z * d.z;
        let room = if a > 1e-24 {
            let b = (o.x * d.x + o.z * d.z) / a;
            // The nearest point to the axis: see the ball.
            let (x, z) = (o.x - b * d.x, o.z - b * d.z);
            let room = self.radius * self.radius - (x * x + z * z);
            let half = (room.max(0.0) / a).sqrt();
            (start, end) = (-b - half, -b + half);
            room
        } else {
            self.radius * self.radius - (o.x * o.x + o.z * o.z)
        };
        if room < 0.0 {
            return None;
        }
        if d.y == 0.0 {
            if o.y.abs() > self.half_height {
                return None;
            }
        } else {
            let (near, far) =
                ((-self.half_height.copysign(d.y) - o.y) / d.y, (self.half_height.copysign(d.y) - o.y) / d.y);
            if near > start {
                (start, start_on_disc) = (near, true);
            }
            if far < end {
                (end, end_on_disc) = (far, true);
            }
        }
        if start > end {
            return None;
        }
        let found =
            [(start, start_on_disc, -1.0), (end, end_on_disc, 1.0)].into_iter().find(|(t, ..)| *t > 0.0 && *t < limit);
        found.map(|(t, on_disc, sign)| {
            let p = ray.at(t);
            let disc = Vector3::new(0.0, sign * d.y.signum(), 0.0);
            (t, if on_disc { disc } else { Vector3::new(p.x, 0.0, p.z) / p.x.hypot(p.z) })
        })
    }

    /// Whether a point is inside.
    pub(super) fn contains(&self, p: &Point3<f64>) -> bool {
        p.x.hypot(p.z) < self.radius && p.y.abs() < self.half_height
    }

    /// Returns the surface as triangles, with `disc_rings` rings of them on each disc.
    pub(super) fn mesh(&self, disc_rings: usize) -> Mesh {
        let (r, h) = (self.radius, self.half_height);
        let mut mesh = revolve(|i| [h - 2.0 * h * i as f64 / N_RINGS as f64, r, 0.0, 1.0]);
        close_with_discs(&mut mesh, disc_rings);
        mesh
    }
}
