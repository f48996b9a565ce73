//! Why a camera file could not be used.

use std::io;
use std::path::{Path, PathBuf};

/// Why a camera file could not be used.
#[derive(Debug, thiserror::Error)]
pub enum CameraFileError {
    /// The file is missing, no regular file, too large, or the operating system would not let it be read.
    #[error(
        "{}: {}", path.display(),
        if source.kind() == io::ErrorKind::NotFound {
            "there is no such file; put the calibration there, or correct its name in rig.toml".into()
        } else {
            format!("cannot be read: {source}")
        }
    )]
    Io {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        source: io::Error,
    },
    /// Neither JSON nor YAML.
    #[error("{}: is not valid {format}: {reason}; write the file again with the tool it came from", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// JSON or YAML.
        format: &'static str,
        /// What the parser said, with line and column.
        reason: String,
    },
    /// A key is missing.
    #[error("{}: has no `{key}`; {remedy}", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// The missing key.
        key: String,
        /// What to do about it.
        remedy: String,
    },
    /// A value that no camera has.
    #[error("{}: `{key}` {problem}; {remedy}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The key.
        key: String,
        /// What is wrong with its value.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
}

impl CameraFileError {
    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        match self {
            CameraFileError::Io { path, .. }
            | CameraFileError::Syntax { path, .. }
            | CameraFileError::Missing { path, .. }
            | CameraFileError::Invalid { path, .. } => path,
        }
    }
}
