//! Forms whose first intersection with a ray is exact. One file per form.
//!
//! Every form promises, in its own frame: `hit(ray, limit)`, the smallest distance in `(0, limit)` at which the ray meets
//! the surface, with a unit normal on either side of it; and `mesh()`, triangles with vertices and normals on the surface,
//! facing outward (toward −z, the camera, where there is no outside). To add one, write its file, add it to [`Shape`], to
//! the spec and to the test of all forms.

mod rectangle;
mod sphere;
mod step;
mod vase;

use nalgebra::Vector3;
use nelu3d_scan::{Mesh, Ray};

use crate::spec::ShapeSpec;
pub(crate) use rectangle::Rectangle;
pub(crate) use sphere::Sphere;
pub(crate) use step::Step;
pub(crate) use vase::Vase;

/// A form in its own frame.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    Rectangle(Rectangle),
    Sphere(Sphere),
    Step(Step),
    Vase(Vase),
}

impl Shape {
    /// The form of a checked spec.
    pub(crate) fn new(spec: &ShapeSpec) -> Self {
        match spec {
            ShapeSpec::Plane { width_mm, height_mm } => {
                let (w, h) = (0.5 * width_mm, 0.5 * height_mm);
                Self::Rectangle(Rectangle::new([-w, -h], [w, h]))
            }
            ShapeSpec::Sphere { radius_mm } => Self::Sphere(Sphere { radius: *radius_mm }),
            ShapeSpec::Step { width_mm, height_mm, jump_mm } => {
                Self::Step(Step { half_width: 0.5 * width_mm, half_height: 0.5 * height_mm, jump: *jump_mm })
            }
            ShapeSpec::Vase { profile_mm } => Self::Vase(Vase::new(profile_mm).expect("checked with the spec")),
        }
    }

    /// The first intersection nearer than `limit`: its distance and a unit normal.
    pub(crate) fn hit(&self, ray: &Ray, limit: f64) -> Option<(f64, Vector3<f64>)> {
        match self {
            Self::Rectangle(s) => s.hit(ray, limit),
            Self::Sphere(s) => s.hit(ray, limit),
            Self::Step(s) => s.hit(ray, limit),
            Self::Vase(s) => s.hit(ray, limit),
        }
    }

    /// The surface as triangles.
    pub(crate) fn mesh(&self) -> Mesh {
        match self {
            Self::Rectangle(s) => s.mesh(),
            Self::Sphere(s) => s.mesh(),
            Self::Step(s) => s.mesh(),
            Self::Vase(s) => s.mesh(),
        }
    }
}

/// Rings and segments of a tessellated solid of revolution; 256 keep chords within 0.01 mm of a 100 mm ball.
const N_RINGS: usize = 256;
const N_SEGMENTS: usize = 256;

/// A closed surface of revolution about the y axis as triangles: `ring(i)` for i in 0..=N_RINGS is
/// `[y, radius, normal_y, normal_r]` from the bottom (largest y) to the top.
fn revolve(ring: impl Fn(usize) -> [f64; 4]) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=N_RINGS {
        let [y, r, ny, nr] = ring(i);
        for j in 0..N_SEGMENTS {
            let (s, c) = (std::f64::consts::TAU * j as f64 / N_SEGMENTS as f64).sin_cos();
            mesh.vertices.push([(r * c) as f32, y as f32, (r * s) as f32]);
            mesh.normals.push([(nr * c) as f32, ny as f32, (nr * s) as f32]);
        }
    }
    let at = |i: usize, j: usize| (i * N_SEGMENTS + j % N_SEGMENTS) as u32;
    for i in 0..N_RINGS {
        for j in 0..N_SEGMENTS {
            mesh.faces.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            mesh.faces.push([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    fn all() -> Vec<Shape> {
        vec![
            Shape::Rectangle(Rectangle::new([-30.0, -20.0], [10.0, 25.0])),
            Shape::Sphere(Sphere { radius: 30.0 }),
            Shape::Step(Step { half_width: 30.0, half_height: 20.0, jump: 12.0 }),
            Shape::Step(Step { half_width: 30.0, half_height: 20.0, jump: -12.0 }),
            Shape::Vase(Vase::new(&[[0.0, 20.0], [15.0, 9.0], [30.0, 22.0], [50.0, 12.0]]).unwrap()),
        ]
    }

    fn point(v: [f32; 3]) -> Vector3<f64> {
        Vector3::from(v.map(f64::from))
    }

    /// Rays aimed from outside at the middle of every triangle hit the surface there, or something in front of it; and what
    /// they hit agrees with the triangle.
    #[test]
    fn meshes_lie_on_the_surfaces_that_rays_hit() {
        for shape in all() {
            let mesh = shape.mesh();
            assert_eq!(mesh.vertices.len(), mesh.normals.len());
            let mut exact = 0;
            let step = (mesh.faces.len() / 500).max(1);
            for face in mesh.faces.iter().step_by(step) {
                let [a, b, c] = face.map(|i| point(mesh.vertices[i as usize]));
                let middle = (a + b + c) / 3.0;
                let cross = (b - a).cross(&(c - a));
                if cross.norm() < 1e-9 {
                    continue;
                }
                let outward = cross.normalize();
                for n in face.map(|i| point(mesh.normals[i as usize])) {
                    assert!(n.dot(&outward) > 0.7, "{shape:?}: normal {n} against {outward}");
                }
                let ray = Ray { origin: Point3::from(middle + outward * 200.0), dir: -outward };
                let (t, normal) = shape.hit(&ray, f64::INFINITY).unwrap_or_else(|| panic!("{shape:?} missed"));
                assert!(t < 200.1, "{shape:?}: {t}");
                assert!((normal.norm() - 1.0).abs() < 1e-9);
                if t > 199.9 {
                    exact += 1;
                    assert!(normal.dot(&outward).abs() > 0.99, "{shape:?}");
                }
            }
            assert!(exact * 2 > mesh.faces.len() / step, "{shape:?}: {exact}");
        }
    }

    #[test]
    fn a_hit_beyond_the_limit_or_behind_is_none() {
        for shape in all() {
            let ray = Ray { origin: Point3::new(-5.0, -5.0, -100.0), dir: Vector3::z() };
            let (t, _) = shape.hit(&ray, f64::INFINITY).unwrap();
            assert!(shape.hit(&ray, t - 1e-6).is_none() && shape.hit(&ray, t + 1e-6).is_some());
            let away = Ray { dir: -Vector3::z(), ..ray };
            assert!(shape.hit(&away, f64::INFINITY).is_none());
        }
    }
}
