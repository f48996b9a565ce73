//! Objects of a scene: a shape in its pose, with its reflectance.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::albedo::AlbedoSpec;
use super::deformation::DeformationSpec;
use super::material::MaterialSpec;
use super::shape::ShapeSpec;

/// A shape in its pose, with its albedo and material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectSpec {
    /// Position of its origin in the camera's frame, mm.
    pub position_mm: [f64; 3],
    /// Its rotation, a Rodrigues vector, object to camera.
    #[serde(default)]
    pub rotation: [f64; 3],
    /// Its shape.
    pub shape: ShapeSpec,
    /// A smooth change of the shape, in the object's frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deformation: Option<DeformationSpec>,
    /// Its albedo.
    #[serde(default)]
    pub albedo: AlbedoSpec,
    /// Its material.
    #[serde(default)]
    pub material: MaterialSpec,
}

impl ObjectSpec {
    /// Returns an object of a shape at a position in the camera's frame, mm: not rotated, gray and matte.
    pub fn new(shape: ShapeSpec, position_mm: [f64; 3]) -> Self {
        let (albedo, material) = (AlbedoSpec::default(), MaterialSpec::default());
        Self { position_mm, rotation: [0.0; 3], shape, deformation: None, albedo, material }
    }

    /// Takes the files that it names from `dir` where they are given relative.
    pub(crate) fn resolve(&mut self, dir: &Path) {
        let absolute = |file: &mut PathBuf| {
            let joined = dir.join(&*file);
            *file = std::path::absolute(&joined).unwrap_or(joined);
        };
        if let ShapeSpec::Mesh { file, .. } = &mut self.shape {
            absolute(file);
        }
        if let AlbedoSpec::Image { file, .. } = &mut self.albedo {
            absolute(file);
        }
    }
}
