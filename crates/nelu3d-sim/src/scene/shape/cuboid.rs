//! A box about the origin.

use nalgebra::Vector3;
use nelu3d_scan::{Mesh, Ray};

/// A box about the origin.
#[derive(Clone, Copy, Debug)]
pub struct Cuboid {
    /// Half sides, mm.
    pub half: [f64; 3],
}

impl Cuboid {
    pub(super) fn hit(&self, ray: &Ray, limit: f64) -> Option<(f64, Vector3<f64>)> {
        let (mut start, mut end) = ((f64::NEG_INFINITY, 0), (f64::INFINITY, 0));
        for i in 0..3 {
            let (o, d, h) = (ray.origin[i], ray.dir[i], self.half[i]);
            if d == 0.0 {
                if o.abs() > h {
                    return None;
                }
                continue;
            }
            let (near, far) = ((-h.copysign(d) - o) / d, (h.copysign(d) - o) / d);
            if near > start.0 {
                start = (near, i);
            }
            if far < end.0 {
                end = (far, i);
            }
        }
        if start.0 > end.0 {
            return None;
        }
        let found = [(start, -1.0), (end, 1.0)].into_iter().find(|((t, _), _)| *t > 0.0 && *t < limit);
        found.map(|((t, i), sign)| (t, Vector3::ith(i, sign * ray.dir[i].signum())))
    }

    /// Whether a point is inside.
    pub(super) fn contains(&self, p: &nalgebra::Point3<f64>) -> bool {
        (0..3).all(|i| p[i].abs() < self.half[i])
    }

    pub(super) fn mesh(&self) -> Mesh {
        let mut mesh = Mesh::default();
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let first = mesh.vertices.len() as u32;
                let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
                for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                    let mut p = [0.0; 3];
                    (p[axis], p[j], p[k]) = (sign * self.half[axis], a * self.half[j], b * self.half[k]);
                    mesh.vertices.push(p.map(|v| v as f32));
                    let mut n = [0.0; 3];
                    n[axis] = sign as f32;
                    mesh.normals.push(n);
                }
                let faces = if sign > 0.0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
                mesh.faces.extend(faces.map(|f| f.map(|i| i + first)));
            }
        }
        mesh
    }
}
