//! Why a recording could not be imported.

use std::io;
use std::path::PathBuf;

use crate::camera::CameraFileError;
use crate::image::ImageFileError;
use crate::rig::RigError;

/// Why a recording could not be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The rig.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// A frame.
    #[error(transparent)]
    Image(#[from] ImageFileError),
    /// The intrinsics of a new rig.
    #[error(transparent)]
    Camera(#[from] CameraFileError),
    /// A folder could not be read.
    #[error("{}: cannot be read: {}", path.display(), crate::input::explain(source))]
    Io {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file or folder could not be written; the message names it.
    #[error(transparent)]
    Write(#[from] io::Error),
    /// The recording, or what was asked for, does not fit.
    #[error("{}: {problem}; {remedy}", path.display())]
    Unfit {
        /// The folder or frame concerned.
        path: PathBuf,
        /// What is wrong.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
    /// The caller asked to stop.
    #[error("stopped")]
    Stopped,
}

impl ImportError {
    pub(super) fn unfit(path: impl Into<PathBuf>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Unfit { path: path.into(), problem: problem.into(), remedy: remedy.into() }
    }
}
