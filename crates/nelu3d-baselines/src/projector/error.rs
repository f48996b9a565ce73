//! Why a projector was not calibrated.

use std::path::PathBuf;

use nelu3d_scan::board::BoardError;
use nelu3d_scan::pose::PoseError;
use nelu3d_scan::rig::RigError;

use crate::error::DecodeError;

/// Why a projector was not calibrated.
#[derive(Debug, thiserror::Error)]
pub enum ProjectorError {
    /// The rig folder or one of its images.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The code.
    #[error(transparent)]
    Code(#[from] DecodeError),
    /// The board in rig.toml.
    #[error("{}: {source}", path.display())]
    Board {
        /// rig.toml.
        path: PathBuf,
        /// What is wrong with it.
        source: BoardError,
    },
    /// The poses of the sweep.
    #[error("{}: {source}", path.display())]
    Pose {
        /// The calibration folder.
        path: PathBuf,
        /// What is wrong.
        source: PoseError,
    },
    /// Something that the calibration needs is missing, or there is too little of it.
    #[error("{}: {problem}; {remedy}", path.display())]
    Needs {
        /// The file or folder.
        path: PathBuf,
        /// What is missing.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
    /// The user stopped it.
    #[error("stopped before the projector was calibrated; nothing was written")]
    Cancelled,
}

impl ProjectorError {
    pub(super) fn needs(path: impl Into<PathBuf>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Needs { path: path.into(), problem: problem.into(), remedy: remedy.into() }
    }
}
