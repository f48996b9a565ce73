//! Errors of specs.

use std::io;
use std::path::{Path, PathBuf};

use nelu3d_scan::image::ImageFileError;
use nelu3d_scan::mesh::MeshFileError;
use nelu3d_scan::pattern::PatternError;

/// Why a spec cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SpecError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        source: io::Error,
    },
    /// An error in a spec file.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The error in it.
        source: Box<SpecError>,
    },
    /// Not TOML, an unknown key, or a value of another type.
    #[error("{reason}; correct the file")]
    Syntax {
        /// The parser's message, with the line.
        reason: String,
    },
    /// A value that makes no sense.
    #[error("`{key}` is {value}; {remedy}")]
    Value {
        /// The key.
        key: String,
        /// Its value.
        value: String,
        /// Instruction what it must be.
        remedy: String,
    },
    /// A mesh that cannot be read.
    #[error("`{key}`: {source}")]
    Mesh {
        /// The key.
        key: String,
        /// The error in the file.
        source: MeshFileError,
    },
    /// A picture that cannot be read.
    #[error("`{key}`: {source}")]
    Image {
        /// The key.
        key: String,
        /// The error in the file.
        source: ImageFileError,
    },
    /// A pattern that cannot be made.
    #[error("pattern set `{set}`: {source}")]
    Pattern {
        /// Name of its set.
        set: String,
        /// The error in it.
        source: PatternError,
    },
}

impl SpecError {
    /// Names the spec file in which the error is.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        Self::File { path: path.into(), source: Box::new(self) }
    }
}
