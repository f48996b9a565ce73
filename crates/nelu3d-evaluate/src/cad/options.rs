//! How a scan is compared with a mesh.

use nalgebra::Isometry3;

/// Where the search for the pose begins. Poses are `cam_from_cad`: from the mesh's frame, scaled, to the camera's, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum InitialPose {
    /// Anywhere: the whole space is searched.
    #[default]
    Search,
    /// At a guess, which is refined.
    Near(Isometry3<f64>),
    /// At the answer, which is not changed.
    Fixed(Isometry3<f64>),
}

/// How a scan is compared with a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CadOptions {
    /// Millimeters per unit of the mesh.
    pub scale: f64,
    /// Where the search for the pose begins.
    pub start: InitialPose,
    /// Distance from the mesh within which a point belongs to the part, mm; 1 % of the mesh's diagonal when `None`.
    pub within_mm: Option<f64>,
    /// Seed of all samples.
    pub seed: u64,
}

impl Default for CadOptions {
    fn default() -> Self {
        Self { scale: 1.0, start: InitialPose::Search, within_mm: None, seed: 0 }
    }
}
