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
use watertight::Shear;

/// Boxes are larger than their triangles by this part of the mesh's radius: more than all rounding in their tests.
const PADDING: f64 = 4e-6;

/// A triangle mesh in its object's frame.
pub(crate) struct Triangles {
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
    /// Returns a mesh of finite vertices whose faces exist.
    pub(crate) fn new(mesh: &Mesh, scale: f64) -> Self {
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

    /// Returns the first intersection nearer than `limit`; among equally near ones that of the first triangle.
    pub(crate) fn hit(&self, ray: &Ray, limit: f64) -> Option<ShapeHit> {
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

    /// Whether the ray meets anything nearer than `limit`.
    pub(crate) fn occludes(&self, ray: &Ray, limit: f64) -> bool {
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

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::random::{RandomPurpose, generator};

    /// Every face tested, none left out.
    fn brute_force(mesh: &Triangles, ray: &Ray) -> Option<(f64, u32)> {
        let shear = Shear::new(ray);
        let hits = (0..mesh.faces.len() as u32).filter_map(|f| Some((shear.hit(mesh.corners(f))?.0, f)));
        hits.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
    }

    #[test]
    fn the_tree_finds_what_testing_every_triangle_finds() {
        let mut random = generator(5, RandomPurpose::Pixels, [0; 3]);
        let mut unit = || 2.0 * random.random::<f64>() - 1.0;
        let mut vector = |scale: f64| Vector3::new(scale * unit(), scale * unit(), scale * unit());
        let (mut hits, mut twice) = (0, 0);
        for far in [0.0, 400.0, 1e5] {
            let mut mesh = Mesh::default();
            for i in 0..600u32 {
                let middle = vector(50.0) + Vector3::new(far, 0.0, -far);
                for _ in 0..3 {
                    let p = middle + vector(if i % 3 == 0 { 40.0 } else { 4.0 });
                    mesh.vertices.push([p.x as f32, p.y as f32, p.z as f32]);
                }
                mesh.faces.push([3 * i, 3 * i + 1, 3 * i + 2]);
                // Equal triangles, so that the same distance comes twice.
                if i % 10 == 0 {
                    mesh.faces.push([3 * i, 3 * i + 1, 3 * i + 2]);
                }
            }
            let mesh = Triangles::new(&mesh, 1.0);
            for i in 0..4000 {
                let origin = Point3::from(vector(300.0)) + Vector3::new(far, 0.0, -far);
                let aim = Point3::from(vector(60.0)) + Vector3::new(far, 0.0, -far);
                let mut dir = (aim - origin).normalize();
                if i % 16 == 0 {
                    // Along an axis the boxes' tests divide by zero.
                    dir = Vector3::ith(i / 16 % 3, 1.0);
                }
                let ray = Ray { origin, dir };
                let expected = brute_force(&mesh, &ray);
                let got = mesh.hit(&ray, f64::INFINITY);
                let face = got.as_ref().and_then(|m| m.mesh_point).map(|p| p.face);
                assert_eq!(got.map(|m| m.t.to_bits()), expected.map(|e| e.0.to_bits()), "{ray:?}");
                assert_eq!(face, expected.map(|e| e.1), "{ray:?}");
                if let Some((t, face)) = expected {
                    hits += 1;
                    twice += usize::from(face % 11 == 0);
                    assert!(mesh.occludes(&ray, t * (1.0 + 1e-12)) && !mesh.occludes(&ray, t));
                    assert!(mesh.hit(&ray, t).is_none());
                }
            }
        }
        assert!(hits > 5000 && twice > 300, "{hits}, {twice}");
    }

    /// Rays at the edges and corners of a closed surface never pass between two triangles.
    #[test]
    fn a_closed_surface_has_no_gaps() {
        let n = 24;
        let sphere = super::super::tessellation::icosphere(30.0, 3);
        let mesh = Triangles::new(&sphere, 1.0);
        let mut rays = 0;
        for face in &mesh.faces {
            let [a, b, c] = face.map(|i| mesh.vertices[i as usize]);
            for i in 0..=n {
                let s = f64::from(i) / f64::from(n);
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    let ray = Ray {
                        origin: Point3::new(1.0, 2.0, 3.0),
                        dir: (from + (to - from) * s - Point3::new(1.0, 2.0, 3.0)).normalize(),
                    };
                    assert!(mesh.hit(&ray, f64::INFINITY).is_some(), "{ray:?}");
                    rays += 1;
                }
            }
        }
        assert!(rays > 90_000, "{rays}");
    }

    #[test]
    fn nothing_is_hit_in_an_empty_mesh() {
        let mesh = Triangles::new(&Mesh::default(), 1.0);
        let ray = Ray { origin: Point3::origin(), dir: Vector3::z() };
        assert!(mesh.hit(&ray, f64::INFINITY).is_none() && !mesh.occludes(&ray, f64::INFINITY));
    }
}
