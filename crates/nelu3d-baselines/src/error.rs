//! Why a scene was not decoded.

use std::path::PathBuf;

use nelu3d::reconstruct::neural::TrainingCheckpointError;
use nelu3d_scan::rig::RigError;

use super::lookup3d;

/// Why a scene was not decoded.
///
/// Messages name a setting by its field, always as: setting `name`. A program can put its own option in its place.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// The rig folder or one of its images.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The lookup table.
    #[error(transparent)]
    Lookup3d(#[from] lookup3d::LookupTableError),
    /// The checkpoint of a training (TurboSL) belongs to something else, or cannot be read or written.
    #[error(transparent)]
    Checkpoint(#[from] TrainingCheckpointError),
    /// A file that the decoder needs is missing or does not fit.
    #[error("{}: {problem}; {remedy}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
    /// A setting that makes no sense.
    #[error("setting `{setting}` {problem}")]
    Setting {
        /// The field of [`DecodeOptions`](crate::DecodeOptions), or of the method's own options.
        setting: &'static str,
        /// What is wrong, and what to do about it.
        problem: String,
    },
    /// The images of a set are no code of the method's kind.
    #[error("pattern set `{set}` cannot be decoded with setting `method` {method}: {problem}; {remedy}")]
    Unsuited {
        /// The set.
        set: String,
        /// The method.
        method: &'static str,
        /// Why not.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
    /// Nothing was decoded.
    #[error("{}: no pixel could be decoded: {reason}", path.display())]
    Nothing {
        /// The scene's folder.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The user stopped it.
    #[error("stopped before the scene was decoded; nothing was written")]
    Cancelled,
}

impl DecodeError {
    pub(crate) fn file(path: impl Into<PathBuf>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::File { path: path.into(), problem: problem.into(), remedy: remedy.into() }
    }
}
