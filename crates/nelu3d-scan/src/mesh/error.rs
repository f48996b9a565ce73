//! Why a mesh file could not be read.

use std::io;
use std::path::PathBuf;

/// Why a mesh file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The file is missing, no regular file, too large, or the operating system would not let it be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        source: io::Error,
    },
    /// Truncated or damaged, or of a kind that is no triangle mesh.
    #[error("{}: cannot be used as a mesh: {reason}; export it again as a triangle mesh", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A file name whose ending says no known format.
    #[error("{}: is of no mesh format that can be read; give a .ply, .obj, .stl or .glb file", path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
}
