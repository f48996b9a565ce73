//! A rectangle in the plane z = 0.

use nalgebra::Vector3;
use nelu3d_scan::{Mesh, Ray};

/// A rectangle in the plane z = 0.
#[derive(Clone, Copy, Debug)]
pub struct Rectangle {
    min: [f64; 2],
    max: [f64; 2],
}

impl Rectangle {
    /// Returns the rectangle between two corners `[x, y]`, mm.
    pub fn new(min: [f64; 2], max: [f64; 2]) -> Self {
        Self { min, max }
    }

    pub(super) fn hit(&self, ray: &Ray, limit: f64) -> Option<(f64, Vector3<f64>)> {
        // A ray in the plane gives infinity or NaN, and neither lies in the range.
        let t = -ray.origin.z / ray.dir.z;
        if !(t > 0.0 && t < limit) {
            return None;
        }
        let p = ray.at(t);
        let inside = p.x >= self.min[0] && p.x <= self.max[0] && p.y >= self.min[1] && p.y <= self.max[1];
        inside.then(|| (t, -Vector3::z()))
    }

    pub(super) fn mesh(&self) -> Mesh {
        let [x0, y0, x1, y1] = [self.min[0], self.min[1], self.max[0], self.max[1]].map(|v| v as f32);
        Mesh {
            vertices: vec![[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]],
            normals: vec![[0.0, 0.0, -1.0]; 4],
            faces: vec![[0, 2, 1], [0, 3, 2]],
            ..Mesh::default()
        }
    }
}
