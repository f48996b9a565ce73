//! Triangles that rays meet exactly: a tree of boxes in `f32` finds candidates, whose intersection is computed in `f64`
//! without gaps between neighbors.

mod watertight;

use nalgebra::{Point3, Vector3};
use nelu3d_scan::{Mesh, Ray};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray as BoxRay, RayHit};

use super::deformation::Deformation;
use super::hit::{MeshPoint, ShapeHit};
pub use watertight::Shear;

/// Boxes are larger than their triangles by this part of the mesh's radius: more than all rounding in their tests.
const PADDING: f64 = 4e-6;

/// A triangle mesh in its object's frame.
pub struct Triangles {
    vertices: Vec<Point3<f64>>,
    /// Vertices before a deformation; empty without one.
    rest: Vec<Point3<f64>>,
    /// Unit vertex normals, or empty.
    normals: Vec<Vector3<f64>>,
    faces: Vec<[u32; 3]>,
    /// Tree of boxes over `vertices − center`.
    tree: Bvh2,
    center: Point3<f64>,
    /// Radius of a ball about `center` with everything in it.
    radius: f64,
}

impl std::fmt::Debug for Triangles {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Triangles({} about {})", self.faces.len(), self.center)
    }
}

impl Triangles {
    /// Returns a mesh of finite vertices whose faces exist, times `scale`.
    ///
    /// # Panics
    ///
    /// If a face names a vertex that does not exist.
    pub fn new(mesh: &Mesh, scale: f64) -> Self {
        let vertices = mesh.vertices.iter().map(|v| Point3::from(v.map(f64::from)) * scale).collect();
        let normals: Vec<Vector3<f64>> = mesh.normals.iter().map(|n| Vector3::from(n.map(f64::from))).collect();
        // A vertex without a direction spoils its triangles: better the flat ones then.
        let smooth = normals.iter().all(|n| n.norm_squared() > 0.5);
        Self::build(vertices, Vec::new(), if smooth { normals } else { Vec::new() }, mesh.faces.clone())
    }

    /// Returns the mesh bent by a deformation of its frame.
    pub(crate) fn deformed(self, deformation: &Deformation) -> Self {
        let vertices = self.vertices.iter().map(|p| deformation.map(p)).collect();
        let normals = self.normals.iter().zip(&self.vertices).map(|(n, p)| deformation.normal(p, n)).collect();
        Self::build(vertices, self.vertices, normals, self.faces)
    }

    fn build(
        vertices: Vec<Point3<f64>>,
        rest: Vec<Point3<f64>>,
        normals: Vec<Vector3<f64>>,
        faces: Vec<[u32; 3]>,
    ) -> Self {
        let used = || faces.iter().flatten().map(|&i| vertices[i as usize]);
        let first = used().next().unwrap_or_default();
        let (low, high) = used().fold((first, first), |(l, h), p| (l.inf(&p), h.sup(&p)));
        let center = nalgebra::center(&low, &high);
        let radius = used().map(|p| (p - center).norm()).fold(0.0, f64::max) * (1.0 + 1e-12);
        let pad = (PADDING * radius) as f32;
        let boxes: Vec<Aabb> = faces
            .iter()
            .map(|f| {
                let corners = f.map(|i| (vertices[i as usize] - center).map(|c| c as f32));
                let low = corners[0].inf(&corners[1]).inf(&corners[2]);
                let high = corners[0].sup(&corners[1]).sup(&corners[2]);
                Aabb::new(
                    [low.x - pad, low.y - pad, low.z - pad].into(),
                    [high.x + pad, high.y + pad, high.z + pad].into(),
                )
            })
            .collect();
        let tree = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut std::time::Duration::default());
        Self { vertices, rest, normals, faces, tree, center, radius }
    }

    /// Returns the first intersection nearer than `limit`, mm; among equally near ones that of the first triangle.
    pub fn hit(&self, ray: &Ray, limit: f64) -> Option<ShapeHit> {
        let (start, box_ray) = self.enter(ray, limit)?;
        let shear = Shear::new(ray);
        let pad = PADDING * self.radius;
        let mut nearest: Option<(f64, u32, [f64; 3])> = None;
        self.tree.ray_traverse(box_ray, &mut RayHit::none(), |_, i| {
            let face = self.tree.primitive_indices[i];
            let Some((t, weights)) = shear.hit(self.corners(face)) else { return f32::INFINITY };
            let nearer = nearest.is_none_or(|(best, other, _)| t < best || (t == best && face < other));
            if t >= limit || !nearer {
                return f32::INFINITY;
            }
            nearest = Some((t, face, weights));
            // Boxes that may hold something as near must still be opened.
            (t - start + pad) as f32 * (1.0 + f32::EPSILON)
        });
        nearest.map(|(t, face, weights)| self.shape_hit(t, face, weights))
    }

    /// Whether the ray meets anything nearer than `limit`, mm.
    pub fn occludes(&self, ray: &Ray, limit: f64) -> bool {
        let Some((_, box_ray)) = self.enter(ray, limit) else { return false };
        let shear = Shear::new(ray);
        !self.tree.ray_traverse_miss(box_ray, |_, i| {
            let hit = shear.hit(self.corners(self.tree.primitive_indices[i]));
            if hit.is_some_and(|(t, _)| t < limit) { f32::NEG_INFINITY } else { f32::INFINITY }
        })
    }

    /// Returns the ray for the tree, and how far along `ray` it starts: close to the mesh, where `f32` is exact enough.
    fn enter(&self, ray: &Ray, limit: f64) -> Option<(f64, BoxRay)> {
        let from = ray.origin - self.center;
        let middle = -from.dot(&ray.dir);
        let miss = (from + ray.dir * middle).norm_squared();
        let room = self.radius * self.radius * (1.0 + 1e-9) - miss;
        if self.faces.is_empty() || room < 0.0 {
            return None;
        }
        let half = room.sqrt();
        let (start, end) = ((middle - half).max(0.0), (middle + half).min(limit));
        if end < start {
            return None;
        }
        let origin = (from + ray.dir * start).map(|c| c as f32);
        let dir = ray.dir.map(|c| c as f32);
        let length = ((end - start) + PADDING * self.radius) as f32 * (1.0 + f32::EPSILON);
        let [origin, dir] = [origin, dir].map(|v| <[f32; 3]>::from(v).into());
        Some((start, BoxRay::new(origin, dir, 0.0, length)))
    }

    fn corners(&self, face: u32) -> [&Point3<f64>; 3] {
        self.faces[face as usize].map(|i| &self.vertices[i as usize])
    }

    fn shape_hit(&self, t: f64, face: u32, weights: [f64; 3]) -> ShapeHit {
        let [a, b, c] = self.corners(face);
        let normal = (b - a).cross(&(c - a)).normalize();
        let point = MeshPoint { face, weights };
        let mut shading_normal = normal;
        if !self.normals.is_empty() {
            let sum: Vector3<f64> = self.interpolate(&point, |i| self.normals[i]);
            let length = sum.norm();
            if length > 1e-6 {
                shading_normal = sum / length;
            }
        }
        ShapeHit { t, normal, shading_normal, mesh_point: Some(point) }
    }

    /// Returns where a point was before the deformation; `None` without one.
    pub(crate) fn at_rest(&self, point: &MeshPoint) -> Option<Point3<f64>> {
        (!self.rest.is_empty()).then(|| Point3::from(self.interpolate(point, |i| self.rest[i].coords)))
    }

    /// Returns a value at a point of the mesh, interpolated between those at the vertices.
    pub(crate) fn interpolate<T>(&self, point: &MeshPoint, value: impl Fn(usize) -> T) -> T
    where
        T: std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>,
    {
        let [a, b, c] = self.faces[point.face as usize].map(|i| value(i as usize));
        let [u, v, w] = point.weights;
        a * u + b * v + c * w
    }

    /// Returns the triangles as a mesh.
    pub(crate) fn mesh(&self) -> Mesh {
        Mesh {
            vertices: self.vertices.iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect(),
            normals: self.normals.iter().map(|n| [n.x as f32, n.y as f32, n.z as f32]).collect(),
            faces: self.faces.clone(),
            ..Mesh::default()
        }
    }
}
