//! The formats of meshes.

/// A format that the surface is written in besides mesh.ply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum MeshFormat {
    /// Wavefront, text.
    Obj,
    /// Stereolithography, binary.
    Stl,
    /// glTF, binary.
    Glb,
}
