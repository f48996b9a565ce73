//! Why a scan cannot be compared with a mesh.

use std::path::PathBuf;

/// A scan that could not be compared with a mesh.
#[derive(Debug, thiserror::Error)]
pub enum CadError {
    /// The mesh has no triangles with an area.
    #[error("the mesh has no triangles; export the part as a triangle mesh, not as points or curves")]
    EmptyMesh,
    /// The result has no or hardly any depth.
    #[error("the result has {found} points, and {needed} are needed; reconstruct the scene again")]
    EmptyScan {
        /// Number of pixels with a depth.
        found: usize,
        /// Minimum number that can be aligned.
        needed: usize,
    },
    /// Mesh and scan differ in size by orders of magnitude.
    #[error(
        "the mesh measures {mesh_mm:.4} mm across and the scan {scan_mm:.4} mm: it seems to be in another unit; \
         try a scale of {suggestion}"
    )]
    Unit {
        /// Diagonal of the mesh, mm.
        mesh_mm: f64,
        /// Diagonal of the scan, mm.
        scan_mm: f64,
        /// A scale that would make them alike.
        suggestion: f64,
    },
    /// No pose explains the scan.
    #[error(
        "the mesh does not fit: at best {:.0} % of the scan lie within {tolerance_mm:.3} mm of it, of its side \
         that faces the camera {:.0} % were found, and {:.0} % lie where the camera saw through; check that it is the \
         right part and unit, or give its pose",
        100.0 * on_mesh, 100.0 * on, 100.0 * in_front
    )]
    NoPose {
        /// Fraction of the scan's points on the mesh, at the best pose.
        on_mesh: f64,
        /// Fraction of the mesh facing the camera that the scan has.
        on: f64,
        /// Fraction of the mesh facing the camera that lies in front of what was measured.
        in_front: f64,
        /// Distance within which a point counts as on the mesh, mm.
        tolerance_mm: f64,
    },
    /// A pose file that cannot be read.
    #[error("{}: {problem}; give cam_from_cad as an alignment.json, or as four rows of four numbers", path.display())]
    Pose {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// The work was cancelled.
    #[error("stopped")]
    Cancelled,
}
