//! Errors of simulations.

use std::io;

use nelu3d_scan::board::BoardError;
use nelu3d_scan::mesh::MeshFileError;
use nelu3d_scan::rig::RigError;

use crate::spec::SpecError;

/// Why nothing was simulated.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// The spec makes no sense.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// The board cannot be printed.
    #[error("`board`: {0}")]
    Board(#[from] BoardError),
    /// The rig cannot be written.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// A file cannot be written; the message names it.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The true mesh cannot be written; the message names the file.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// The caller stopped the work.
    #[error("stopped before the rig was finished; nothing was written")]
    Stopped,
}
