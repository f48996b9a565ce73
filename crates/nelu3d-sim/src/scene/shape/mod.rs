//! Shapes whose first intersection with a ray is exact. One file per shape; triangles have a folder of their own.
//!
//! Every closed form promises, in its own frame: `hit(ray, limit)`, the smallest distance in `(0, limit)` at which the
//! ray meets the surface, with a unit normal on either side of it; and `mesh()`, triangles with vertices and normals on
//! the surface, facing outward (toward −z, the camera, where there is no outside). To add one, write its file, add it
//! to [`Shape`], to the spec and to the test of all shapes.

mod cuboid;
mod cylinder;
mod rectangle;
mod roots;
mod sphere;
mod spline;
mod step;
mod torus;
mod vase;

use std::sync::Arc;

use nalgebra::Point3;
use nelu3d_scan::{Mesh, Ray};

use super::deformation::Deformation;
use super::hit::ShapeHit;
use super::tessellation::subdivide;
use super::triangles::Triangles;
use crate::spec::{DeformationSpec, ShapeSpec};
pub(crate) use cuboid::Cuboid;
pub(crate) use cylinder::Cylinder;
pub(crate) use rectangle::Rectangle;
pub(crate) use sphere::Sphere;
pub(crate) use step::Step;
pub(crate) use torus::Torus;
pub(crate) use vase::Vase;

/// Times that a flat side is subdivided before it is bent: into 256 × 256 squares.
const FLAT_LEVELS: usize = 8;

/// Rings of triangles of a disc that is bent.
const FINE_DISC_RINGS: usize = 64;

/// A shape in its own frame.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    Rectangle(Rectangle),
    Sphere(Sphere),
    Step(Step),
    Vase(Vase),
    Cuboid(Cuboid),
    Cylinder(Cylinder),
    Torus(Torus),
    Triangles(Arc<Triangles>),
}

impl Shape {
    /// Returns the shape of a checked spec; `mesh` has the triangles of [`ShapeSpec::Mesh`].
    pub(crate) fn new(spec: &ShapeSpec, mesh: &Mesh) -> Self {
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
            ShapeSpec::Box { size_mm } => Self::Cuboid(Cuboid { half: size_mm.map(|s| 0.5 * s) }),
            ShapeSpec::Cylinder { radius_mm, height_mm } => {
                Self::Cylinder(Cylinder { radius: *radius_mm, half_height: 0.5 * height_mm })
            }
            ShapeSpec::Torus { major_mm, minor_mm } => Self::Torus(Torus { major: *major_mm, minor: *minor_mm }),
            ShapeSpec::Mesh { scale, .. } => Self::Triangles(Arc::new(Triangles::new(mesh, *scale))),
        }
    }

    /// Returns the shape as triangles, bent.
    pub(crate) fn deformed(self, spec: &DeformationSpec) -> Self {
        let triangles = match self {
            Self::Triangles(t) => Arc::try_unwrap(t).unwrap_or_else(|t| Triangles::new(&t.mesh(), 1.0)),
            _ => Triangles::new(&self.fine_mesh(), 1.0),
        };
        Self::Triangles(Arc::new(triangles.deformed(&Deformation(*spec))))
    }

    /// Returns the first intersection nearer than `limit`.
    pub(crate) fn hit(&self, ray: &Ray, limit: f64) -> Option<ShapeHit> {
        let exact = match self {
            Self::Rectangle(s) => s.hit(ray, limit),
            Self::Sphere(s) => s.hit(ray, limit),
            Self::Step(s) => s.hit(ray, limit),
            Self::Vase(s) => s.hit(ray, limit),
            Self::Cuboid(s) => s.hit(ray, limit),
            Self::Cylinder(s) => s.hit(ray, limit),
            Self::Torus(s) => s.hit(ray, limit),
            Self::Triangles(s) => return s.hit(ray, limit),
        };
        exact.map(|(t, normal)| ShapeHit { t, normal, shading_normal: normal, mesh_point: None })
    }

    /// Whether the ray meets anything nearer than `limit`.
    pub(crate) fn occludes(&self, ray: &Ray, limit: f64) -> bool {
        match self {
            Self::Triangles(s) => s.occludes(ray, limit),
            _ => self.hit(ray, limit).is_some(),
        }
    }

    /// Whether no light goes from one point of the surface to another, on the side seen from `eye`.
    pub(crate) fn is_convex_from(&self, eye: &Point3<f64>) -> bool {
        match self {
            Self::Rectangle(_) => true,
            Self::Sphere(s) => !s.contains(eye),
            Self::Cuboid(s) => !s.contains(eye),
            Self::Cylinder(s) => !s.contains(eye),
            Self::Step(_) | Self::Vase(_) | Self::Torus(_) | Self::Triangles(_) => false,
        }
    }

    /// Returns the surface as triangles.
    pub(crate) fn mesh(&self) -> Mesh {
        match self {
            Self::Rectangle(s) => s.mesh(),
            Self::Sphere(s) => s.mesh(),
            Self::Step(s) => s.mesh(),
            Self::Vase(s) => s.mesh(1),
            Self::Cuboid(s) => s.mesh(),
            Self::Cylinder(s) => s.mesh(1),
            Self::Torus(s) => s.mesh(),
            Self::Triangles(s) => s.mesh(),
        }
    }

    /// Returns the surface as triangles that are small enough to be bent.
    fn fine_mesh(&self) -> Mesh {
        match self {
            Self::Rectangle(_) | Self::Step(_) | Self::Cuboid(_) => {
                (0..FLAT_LEVELS).fold(self.mesh(), |m, _| subdivide(&m))
            }
            Self::Vase(s) => s.mesh(FINE_DISC_RINGS),
            Self::Cylinder(s) => s.mesh(FINE_DISC_RINGS),
            Self::Sphere(_) | Self::Torus(_) | Self::Triangles(_) => self.mesh(),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::scene::tessellation::icosphere;

    fn all() -> Vec<Shape> {
        vec![
            Shape::Rectangle(Rectangle::new([-30.0, -20.0], [10.0, 25.0])),
            Shape::Sphere(Sphere { radius: 30.0 }),
            Shape::Step(Step { half_width: 30.0, half_height: 20.0, jump: 12.0 }),
            Shape::Step(Step { half_width: 30.0, half_height: 20.0, jump: -12.0 }),
            Shape::Vase(Vase::new(&[[0.0, 20.0], [15.0, 9.0], [30.0, 22.0], [50.0, 12.0]]).unwrap()),
            Shape::Cuboid(Cuboid { half: [30.0, 20.0, 10.0] }),
            Shape::Cylinder(Cylinder { radius: 20.0, half_height: 30.0 }),
            Shape::Torus(Torus { major: 15.0, minor: 8.0 }),
            Shape::Triangles(Arc::new(Triangles::new(&icosphere(30.0, 4), 1.0))),
            Shape::Rectangle(Rectangle::new([-30.0, -20.0], [30.0, 25.0]))
                .deformed(&DeformationSpec::Bend { curvature_per_mm: 0.02, axis: crate::spec::AxisSpec::Y }),
            Shape::Cylinder(Cylinder { radius: 12.0, half_height: 30.0 })
                .deformed(&DeformationSpec::Twist { rate_per_mm: 0.01, axis: crate::spec::AxisSpec::Y }),
        ]
    }

    /// Without the thousands of numbers of a mesh.
    fn name(shape: &Shape) -> String {
        format!("{shape:?}").chars().take(80).collect()
    }

    fn point(v: [f32; 3]) -> Vector3<f64> {
        Vector3::from(v.map(f64::from))
    }

    /// Rays aimed from outside at the middle of every triangle hit the surface there, or something in front of it; and
    /// what they hit agrees with the triangle.
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
                    assert!(n.dot(&outward) > 0.7, "{}: normal {n} against {outward}", name(&shape));
                }
                let ray = Ray { origin: Point3::from(middle + outward * 200.0), dir: -outward };
                let ShapeHit { t, normal, .. } =
                    shape.hit(&ray, f64::INFINITY).unwrap_or_else(|| panic!("{} missed", name(&shape)));
                assert!(t < 200.1, "{}: {t}", name(&shape));
                assert!((normal.norm() - 1.0).abs() < 1e-9);
                if t > 199.9 {
                    exact += 1;
                    assert!(normal.dot(&outward).abs() > 0.99, "{}", name(&shape));
                }
            }
            assert!(exact * 2 > mesh.faces.len() / step, "{}: {exact}", name(&shape));
        }
    }

    #[test]
    fn a_hit_beyond_the_limit_or_behind_is_none() {
        for shape in all() {
            let ray = Ray { origin: Point3::new(-5.0, -5.0, -100.0), dir: Vector3::z() };
            let t = shape.hit(&ray, f64::INFINITY).unwrap().t;
            assert!(shape.hit(&ray, t - 1e-6).is_none() && shape.hit(&ray, t + 1e-6).is_some());
            let away = Ray { dir: -Vector3::z(), ..ray };
            assert!(shape.hit(&away, f64::INFINITY).is_none());
        }
    }
}
