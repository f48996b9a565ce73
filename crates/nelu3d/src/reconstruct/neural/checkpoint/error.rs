//! Why a checkpoint could not be used or written.

use std::io;
use std::path::PathBuf;

/// The error of a checkpoint that could not be used or written.
#[derive(Debug, thiserror::Error)]
pub enum TrainingCheckpointError {
    /// The file could not be read.
    #[error("{path}: the training's checkpoint cannot be read: {source}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: io::Error,
    },
    /// The file could not be written; the message names it.
    #[error(transparent)]
    Write(io::Error),
    /// The file is no checkpoint, or a damaged one.
    #[error("{path}: is no whole checkpoint of a training; delete it to train from the start", path = path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
    },
    /// The file belongs to a training of something else.
    #[error(
        "{path}: the checkpoint is of a training with {what}; give another file, or delete it to train from the start",
        path = path.display()
    )]
    Other {
        /// The file.
        path: PathBuf,
        /// What differs.
        what: &'static str,
    },
}
