//! Objects of a scene.

use nalgebra::{Isometry3, Vector3};
use nelu3d_scan::{Mesh, Ray};

use super::albedo::Albedo;
use super::hit::{ShapeHit, SurfaceHit};
use super::material::Material;
use super::shape::Shape;
use crate::spec::{AlbedoSpec, ObjectSpec, ShapeSpec, SpecError};

/// A shape in its pose, with its albedo and material.
#[derive(Clone, Debug)]
pub(super) struct SceneObject {
    pub(super) shape: Shape,
    pub(super) cam_from_object: Isometry3<f64>,
    pub(super) object_from_cam: Isometry3<f64>,
    pub(super) albedo: Albedo,
    pub(super) material: Material,
}

impl SceneObject {
    pub(super) fn new(shape: Shape, cam_from_object: Isometry3<f64>, albedo: Albedo, material: Material) -> Self {
        Self { shape, cam_from_object, object_from_cam: cam_from_object.inverse(), albedo, material }
    }

    /// Moves the object in the camera's frame.
    pub(super) fn move_by(&mut self, motion: &Isometry3<f64>) {
        self.cam_from_object = motion * self.cam_from_object;
        self.object_from_cam = self.cam_from_object.inverse();
    }

    /// Returns the object of a spec with its files; `key` names its fields in messages.
    ///
    /// # Errors
    ///
    /// A file that cannot be read, or lacks triangles or colors.
    pub(super) fn read(spec: &ObjectSpec, key: &dyn Fn(&str) -> String) -> Result<Self, SpecError> {
        let mesh = match &spec.shape {
            ShapeSpec::Mesh { file, .. } => {
                Mesh::read(file).map_err(|source| SpecError::Mesh { key: key("shape.file"), source })?
            }
            _ => Mesh::default(),
        };
        let nothing = |what: &str, key: String, remedy: &str| {
            let ShapeSpec::Mesh { file, .. } = &spec.shape else { return Ok(()) };
            let value = format!("{}, which has no {what}", file.display());
            Err(SpecError::Value { key, value, remedy: remedy.into() })
        };
        if mesh.faces.is_empty() {
            nothing("triangles", key("shape.file"), "give a mesh with faces")?;
        }
        if matches!(spec.albedo, AlbedoSpec::VertexColors { .. }) && mesh.colors.is_empty() {
            nothing("vertex colors", key("albedo.kind"), "give another albedo, or a mesh with colors")?;
        }
        let albedo = Albedo::new(&spec.albedo, &mesh.colors)
            .map_err(|source| SpecError::Image { key: key("albedo.file"), source })?;
        let mut shape = Shape::new(&spec.shape, &mesh);
        if let Some(deformation) = &spec.deformation {
            shape = shape.deformed(deformation);
        }
        let cam_from_object = Isometry3::new(Vector3::from(spec.position_mm), Vector3::from(spec.rotation));
        Ok(Self::new(shape, cam_from_object, albedo, Material::new(&spec.material)))
    }

    /// Returns the surface point of an intersection of `ray` (in the camera's frame; `local` in the object's). `object`
    /// is the index of this object.
    pub(super) fn surface_hit(&self, object: usize, ray: &Ray, local: &Ray, shape_hit: &ShapeHit) -> SurfaceHit {
        let mut geometric_normal = self.cam_from_object * shape_hit.normal;
        if geometric_normal.dot(&ray.dir) > 0.0 {
            geometric_normal = -geometric_normal;
        }
        let mut shading_normal = geometric_normal;
        let mut object_point = local.at(shape_hit.t);
        if let (Some(mesh_point), Shape::Triangles(triangles)) = (&shape_hit.mesh_point, &self.shape) {
            shading_normal = self.cam_from_object * shape_hit.shading_normal;
            if shading_normal.dot(&geometric_normal) < 0.0 {
                shading_normal = -shading_normal;
            }
            // Paint moves with the surface.
            object_point = triangles.at_rest(mesh_point).unwrap_or(object_point);
        }
        let (point, mesh_point) = (ray.at(shape_hit.t), shape_hit.mesh_point);
        SurfaceHit { point, shading_normal, geometric_normal, object, object_point, mesh_point }
    }

    /// Returns a ray of the camera's frame in the object's.
    pub(super) fn to_object_frame(&self, ray: &Ray) -> Ray {
        Ray { origin: self.object_from_cam * ray.origin, dir: self.object_from_cam * ray.dir }
    }
}

/// Reads the files that an object names, to see whether they can be used; `key` names its fields in messages.
///
/// # Errors
///
/// Under its key, the file that cannot.
pub(crate) fn check_files(spec: &ObjectSpec, key: &dyn Fn(&str) -> String) -> Result<(), SpecError> {
    let has_files = matches!(spec.shape, ShapeSpec::Mesh { .. }) || matches!(spec.albedo, AlbedoSpec::Image { .. });
    if has_files { SceneObject::read(spec, key).map(drop) } else { Ok(()) }
}
