//! Shapes whose first intersection with a ray is exact. One file per shape; triangles have a folder of their own.
//!
//! Every closed form promises, in its own frame: `hit(ray, limit)`, the smallest distance in `(0, limit)` at which the
//! ray meets the surface, with a unit normal on either side of it; and `mesh()`, triangles with vertices and normals on
//! the surface, facing outward (toward −z, the camera, where there is no outside). To add one, write its file, add it
//! to [`Shape`], to the spec and to the test of all shapes (`tests/unit/scene/shape`).

mod cuboid;
mod cylinder;
mod rectangle;
pub mod roots;
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
pub use cuboid::Cuboid;
pub use cylinder::Cylinder;
pub use rectangle::Rectangle;
pub use sphere::Sphere;
pub use step::Step;
pub use torus::Torus;
pub use vase::Vase;

/// Times that a flat side is subdivided before it is bent: into 256 × 256 squares.
const FLAT_LEVELS: usize = 8;

/// Rings of triangles of a disc that is bent.
const FINE_DISC_RINGS: usize = 64;

/// A shape in its own frame.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A rectangle in the plane z = 0.
    Rectangle(Rectangle),
    /// A ball about the origin.
    Sphere(Sphere),
    /// Two rectangles side by side at different depths, joined by a wall.
    Step(Step),
    /// A solid of revolution about the y axis.
    Vase(Vase),
    /// A box about the origin.
    Cuboid(Cuboid),
    /// A cylinder about the y axis.
    Cylinder(Cylinder),
    /// A ring about the y axis.
    Torus(Torus),
    /// A mesh.
    Triangles(Arc<Triangles>),
}

impl Shape {
    /// Returns the shape of a spec; `mesh` has the triangles of [`ShapeSpec::Mesh`].
    ///
    /// # Panics
    ///
    /// If the profile of a vase makes none, which [`Spec::check`](crate::Spec::check) finds.
    pub fn new(spec: &ShapeSpec, mesh: &Mesh) -> Self {
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

    /// Returns the shape as triangles, bent by a deformation of the shape's frame.
    pub fn deformed(self, spec: &DeformationSpec) -> Self {
        let triangles = match self {
            Self::Triangles(t) => Arc::try_unwrap(t).unwrap_or_else(|t| Triangles::new(&t.mesh(), 1.0)),
            _ => Triangles::new(&self.fine_mesh(), 1.0),
        };
        Self::Triangles(Arc::new(triangles.deformed(&Deformation(*spec))))
    }

    /// Returns the first intersection with a ray of the shape's frame, nearer than `limit`, mm.
    pub fn hit(&self, ray: &Ray, limit: f64) -> Option<ShapeHit> {
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
    pub fn mesh(&self) -> Mesh {
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
