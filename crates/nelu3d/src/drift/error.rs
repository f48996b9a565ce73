//! Errors of a check for drift.

use std::path::PathBuf;

use nelu3d_scan::rig::RigError;

use crate::color_field::FieldMismatch;

/// The error of a check for drift.
#[derive(Debug, thiserror::Error)]
pub enum DriftError {
    /// The rig folder or one of its images cannot be used.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The color field was made for something else.
    #[error(transparent)]
    Mismatch(#[from] FieldMismatch),
    /// The captures do not tell whether something moved.
    #[error("{path}: {reason}; put the rig's board where the sweep was, and take white, black and all patterns")]
    NoBoard {
        /// Folder of the captures.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The work was stopped by its caller.
    #[error("stopped")]
    Cancelled,
}
