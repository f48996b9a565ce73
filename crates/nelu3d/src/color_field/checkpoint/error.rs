//! Errors of checkpoints.

use std::path::PathBuf;

use super::header::FORMAT;

/// The error of a checkpoint that could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file could not be read.
    #[error("{path}: cannot be read: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        source: std::io::Error,
    },
    /// The file could not be written; the message names it.
    #[error(transparent)]
    Write(#[from] std::io::Error),
    /// The file is no checkpoint, or not a whole one.
    #[error("{path}: is no readable color field ({reason}); it may be truncated: calibrate again")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The file was written by a newer version.
    #[error("{path}: color field format {found} is newer than the newest known here, {FORMAT}; update nelu3d")]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
    },
}
