//! Errors of a reconstruction.

use std::path::{Path, PathBuf};

use nelu3d_field::device::DeviceError;
use nelu3d_scan::rig::RigError;

use super::neural::checkpoint::TrainingCheckpointError;
use crate::color_field::FieldMismatch;

/// The error of a rig's scene that could not be reconstructed.
#[derive(Debug, thiserror::Error)]
pub enum ReconstructionError {
    /// The rig folder or one of its images cannot be used.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The color field was made for something else.
    #[error(transparent)]
    Mismatch(#[from] FieldMismatch),
    /// The device that was asked for is not there.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// No pixel can be reconstructed.
    #[error("{path}: no pixel can be reconstructed: {reason}")]
    Nothing {
        /// The scene's folder.
        path: PathBuf,
        /// Why every pixel was rejected, and what to check.
        reason: String,
    },
    /// The checkpoint of the training belongs to something else, or cannot be read or written.
    #[error(transparent)]
    Checkpoint(#[from] TrainingCheckpointError),
    /// The caller stopped the work.
    #[error("stopped before the surface was finished; nothing was written")]
    Cancelled,
}

/// The error of a capture that could not be reconstructed, whatever folder it belongs to.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Every pixel was rejected; the text says why.
    #[error("no pixel can be reconstructed: {0}")]
    Nothing(String),
    /// The checkpoint of the training belongs to something else, or cannot be read or written.
    #[error(transparent)]
    Checkpoint(#[from] TrainingCheckpointError),
    /// The caller stopped the work.
    #[error("stopped before the surface was finished")]
    Cancelled,
}

impl Failure {
    /// The error of a scene that lies in the folder `scene`.
    pub fn at(self, scene: &Path) -> ReconstructionError {
        match self {
            Failure::Nothing(reason) => ReconstructionError::Nothing { path: scene.to_owned(), reason },
            Failure::Checkpoint(e) => ReconstructionError::Checkpoint(e),
            Failure::Cancelled => ReconstructionError::Cancelled,
        }
    }
}
