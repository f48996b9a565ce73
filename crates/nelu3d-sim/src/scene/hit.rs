//! Where rays meet surfaces.

use nalgebra::{Point3, Vector3};

/// A point of a triangle mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshPoint {
    /// Index of the triangle.
    pub face: u32,
    /// Barycentric coordinates: the weights of the triangle's corners.
    pub weights: [f64; 3],
}

/// The intersection of a ray and a shape, in the shape's frame.
#[derive(Clone, Copy, Debug)]
pub struct ShapeHit {
    /// Distance along the ray, mm.
    pub t: f64,
    /// Unit normal of the surface itself, on either side.
    pub normal: Vector3<f64>,
    /// Unit normal of the smooth surface that triangles stand for; of a closed form the same as `normal`.
    pub shading_normal: Vector3<f64>,
    /// The point of the triangle mesh; none of a closed form.
    pub mesh_point: Option<MeshPoint>,
}

/// The first surface point along a ray, in the camera's frame.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceHit {
    /// The point, mm.
    pub point: Point3<f64>,
    /// Unit normal on the ray's side for reflection: of the smooth surface that a mesh stands for.
    pub shading_normal: Vector3<f64>,
    /// Unit normal of the surface itself on the ray's side.
    pub(super) geometric_normal: Vector3<f64>,
    /// Index of the object in the scene.
    pub object: usize,
    /// The point in the object's frame, before a deformation: where its albedo is looked up.
    pub(super) object_point: Point3<f64>,
    /// The point of the object's triangles, where it has some.
    pub(super) mesh_point: Option<MeshPoint>,
}
