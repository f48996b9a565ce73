//! Two rectangles side by side at different depths, joined by a wall.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::{Mesh, Ray};

use super::rectangle::Rectangle;

/// Two rectangles side by side at different depths, joined by a wall.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Half of the width of both together, mm.
    pub half_width: f64,
    /// Half of their height, mm.
    pub half_height: f64,
    /// z of the half with x > 0, mm; the other lies at 0.
    pub jump: f64,
}

impl Step {
    fn left(&self) -> Rectangle {
        Rectangle::new([-self.half_width, -self.half_height], [0.0, self.half_height])
    }

    fn right(&self) -> Rectangle {
        Rectangle::new([0.0, -self.half_height], [self.half_width, self.half_height])
    }

    /// Returns the outward normal of the wall, which points to the half that lies deeper.
    fn wall_normal(&self) -> Vector3<f64> {
        Vector3::new(self.jump.signum(), 0.0, 0.0)
    }

    pub(super) fn hit(&self, ray: &Ray, limit: f64) -> Option<(f64, Vector3<f64>)> {
        let lowered = Ray { origin: ray.origin - Vector3::new(0.0, 0.0, self.jump), ..*ray };
        let halves = [self.left().hit(ray, limit), self.right().hit(&lowered, limit)];
        let t = -ray.origin.x / ray.dir.x;
        let p = ray.at(t);
        let (low, high) = (self.jump.min(0.0), self.jump.max(0.0));
        let on_wall = t > 0.0 && t < limit && p.z > low && p.z < high && p.y.abs() <= self.half_height;
        let wall = on_wall.then(|| (t, self.wall_normal()));
        halves.into_iter().chain([wall]).flatten().min_by(|a, b| a.0.total_cmp(&b.0))
    }

    pub(super) fn mesh(&self) -> Mesh {
        let mut mesh = self.left().mesh();
        let mut right = self.right().mesh();
        for v in &mut right.vertices {
            v[2] += self.jump as f32;
        }
        let h = self.half_height;
        let corner = |y: f64, z: f64| Point3::new(0.0, y, z).coords;
        let mut wall = [corner(-h, 0.0), corner(h, 0.0), corner(h, self.jump), corner(-h, self.jump)];
        if (wall[1] - wall[0]).cross(&(wall[2] - wall[0])).dot(&self.wall_normal()) < 0.0 {
            wall.reverse();
        }
        let n = self.wall_normal();
        let wall = Mesh {
            vertices: wall.map(|p| [p.x as f32, p.y as f32, p.z as f32]).to_vec(),
            normals: vec![[n.x as f32, 0.0, 0.0]; 4],
            faces: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        for part in [right, wall] {
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(part.vertices);
            mesh.normals.extend(part.normals);
            mesh.faces.extend(part.faces.iter().map(|f| f.map(|i| i + first)));
        }
        mesh
    }
}
