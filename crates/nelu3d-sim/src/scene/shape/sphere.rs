//! A ball about the origin.

use std::f64::consts::PI;

use nalgebra::{Point3, Vector3};
use nelu3d_scan::{Mesh, Ray};

use crate::scene::tessellation::{N_RINGS, revolve};

/// A ball about the origin.
#[derive(Clone, Copy, Debug)]
pub struct Sphere {
    /// Radius, mm.
    pub radius: f64,
}

impl Sphere {
    pub(super) fn hit(&self, ray: &Ray, limit: f64) -> Option<(f64, Vector3<f64>)> {
        let o = ray.origin.coords;
        let b = o.dot(&ray.dir);
        // The distance of the ray's nearest point to the center, squared: more exact than b² − (|o|² − r²) far away.
        let miss = (o - ray.dir * b).norm_squared();
        let half_chord = (self.radius * self.radius - miss).max(0.0).sqrt();
        if miss > self.radius * self.radius {
            return None;
        }
        let t = [-b - half_chord, -b + half_chord].into_iter().find(|t| *t > 0.0 && *t < limit)?;
        Some((t, (ray.at(t).coords / self.radius).normalize()))
    }

    /// Whether a point is inside.
    pub(super) fn contains(&self, p: &Point3<f64>) -> bool {
        p.coords.norm() < self.radius
    }

    pub(super) fn mesh(&self) -> Mesh {
        revolve(|i| {
            let (s, c) = (PI * i as f64 / N_RINGS as f64).sin_cos();
            [self.radius * c, self.radius * s, c, s]
        })
    }
}
