//! What the camera sees: closed-form objects and triangles, with exact intersections. The sweep's board is such an
//! object too.

mod albedo;
mod board;
mod deformation;
mod hand;
mod hit;
mod material;
mod object;
pub mod shape;
pub mod tessellation;
pub mod triangles;

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_scan::{Mesh, Ray};

use crate::geometry::orthonormal_basis;
use crate::spec::{ObjectSpec, SpecError};
pub use albedo::Albedo;
pub use board::PrintedBoard;
pub use deformation::Deformation;
pub use hand::Hand;
pub use hit::{MeshPoint, ShapeHit, SurfaceHit};
pub use material::GlossyCoating;
pub(crate) use material::Material;
use object::SceneObject;
pub(crate) use object::check_files;
use shape::Shape;

/// Distance that a surface keeps from the rays that start on it, mm.
const SURFACE_OFFSET_MM: f64 = 1e-4;

/// Objects in the camera's frame, mm.
#[derive(Clone, Debug)]
pub struct VirtualScene {
    objects: Vec<SceneObject>,
}

impl VirtualScene {
    /// Returns the scene of the objects of a checked spec.
    ///
    /// # Errors
    ///
    /// A file that an object names cannot be read (any more).
    pub fn new(objects: &[ObjectSpec]) -> Result<Self, SpecError> {
        let objects = objects.iter().map(|o| SceneObject::read(o, &|field: &str| format!("objects.{field}")));
        Ok(Self { objects: objects.collect::<Result<_, _>>()? })
    }

    /// Returns the scene of a board by itself, at a pose, with the hands that hold it.
    pub fn of_board(printed: &PrintedBoard, cam_from_board: &Isometry3<f64>, hands: &[Hand]) -> Self {
        Self { objects: printed.objects(cam_from_board, hands) }
    }

    /// Puts what another scene has into this one.
    pub(crate) fn add(&mut self, other: Self) {
        self.objects.extend(other.objects);
    }

    /// Moves everything in the camera's frame.
    pub(crate) fn move_by(&mut self, motion: &Isometry3<f64>) {
        self.objects.iter_mut().for_each(|o| o.move_by(motion));
    }

    /// Returns the first surface point along a ray of the camera's frame.
    pub fn hit(&self, ray: &Ray) -> Option<SurfaceHit> {
        let mut nearest: Option<(usize, Ray, ShapeHit)> = None;
        for (i, o) in self.objects.iter().enumerate() {
            let limit = nearest.as_ref().map_or(f64::INFINITY, |(_, _, hit)| hit.t);
            let local = o.to_object_frame(ray);
            if let Some(hit) = o.shape.hit(&local, limit) {
                nearest = Some((i, local, hit));
            }
        }
        nearest.map(|(i, local, hit)| self.objects[i].surface_hit(i, ray, &local, &hit))
    }

    /// Whether nothing stands between a surface point and the point `to`.
    pub fn is_visible_from(&self, hit: &SurfaceHit, to: &Point3<f64>) -> bool {
        let origin = hit.point + hit.geometric_normal * SURFACE_OFFSET_MM;
        let offset = to - origin;
        let distance = offset.norm();
        let ray = Ray { origin, dir: offset / distance };
        self.objects.iter().all(|o| !o.shape.occludes(&o.to_object_frame(&ray), distance))
    }

    /// Returns the first surface point in a direction from another; none behind the surface itself.
    pub(crate) fn hit_from(&self, hit: &SurfaceHit, dir: Vector3<f64>) -> Option<SurfaceHit> {
        if dir.dot(&hit.geometric_normal) <= 0.0 {
            return None;
        }
        self.hit(&Ray { origin: hit.point + hit.geometric_normal * SURFACE_OFFSET_MM, dir })
    }

    /// Samples where light enters a translucent surface that leaves it at `hit`: a point of the same surface in any
    /// direction, at a distance that is exponentially distributed. Where the surface ends before, it is the point
    /// itself. `u` are two random numbers.
    pub(crate) fn sample_subsurface_entry(&self, hit: &SurfaceHit, mean_distance: f64, u: [f64; 2]) -> SurfaceHit {
        let distance = -mean_distance * (1.0 - u[0]).ln();
        let (sine, cosine) = (TAU * u[1]).sin_cos();
        let offset = orthonormal_basis(&hit.geometric_normal) * Vector3::new(distance * cosine, distance * sine, 0.0);
        // Surfaces bend away from the tangent plane by at most about the distance.
        let reach = distance.max(SURFACE_OFFSET_MM);
        let ray = Ray { origin: hit.point + offset + hit.geometric_normal * reach, dir: -hit.geometric_normal };
        let o = &self.objects[hit.object];
        let local = o.to_object_frame(&ray);
        let shape_hit = o.shape.hit(&local, 2.0 * reach);
        shape_hit.map_or(*hit, |shape_hit| o.surface_hit(hit.object, &ray, &local, &shape_hit))
    }

    /// Returns the part of each band of light (red, green, blue) that the surface reflects.
    pub fn albedo(&self, hit: &SurfaceHit) -> [f32; 3] {
        let o = &self.objects[hit.object];
        match (&o.albedo, &o.shape, hit.mesh_point) {
            (Albedo::Vertices(colors), Shape::Triangles(t), Some(point)) => {
                let rgb = t.interpolate(&point, |i| colors[i]);
                [rgb.x as f32, rgb.y as f32, rgb.z as f32]
            }
            _ => o.albedo.at(&hit.object_point),
        }
    }

    /// Returns the material of a surface point.
    pub(crate) fn material(&self, hit: &SurfaceHit) -> &Material {
        &self.objects[hit.object].material
    }

    /// Whether light can go from one of the surfaces to another and then to the camera.
    pub(crate) fn has_interreflection(&self) -> bool {
        match self.objects.as_slice() {
            [] => false,
            [only] => !only.shape.is_convex_from(&(only.object_from_cam * Point3::origin())),
            _ => true,
        }
    }

    /// Returns all surfaces as triangles in the camera's frame, with vertices and normals on the true surface; of a
    /// mesh, its own.
    pub(crate) fn mesh(&self) -> Mesh {
        let mut all = Mesh::default();
        for o in &self.objects {
            let mut part = o.shape.mesh();
            if part.normals.is_empty() {
                part.compute_normals();
            }
            let first = all.vertices.len() as u32;
            all.vertices.extend(part.vertices.iter().map(|v| {
                let p = o.cam_from_object * Point3::from(v.map(f64::from));
                [p.x as f32, p.y as f32, p.z as f32]
            }));
            all.normals.extend(part.normals.iter().map(|n| {
                let n = o.cam_from_object * Vector3::from(n.map(f64::from));
                [n.x as f32, n.y as f32, n.z as f32]
            }));
            all.faces.extend(part.faces.iter().map(|f| f.map(|i| i + first)));
        }
        all
    }
}
