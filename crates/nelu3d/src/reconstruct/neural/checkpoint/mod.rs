//! Checkpoints of a training: an interrupted one goes on bit for bit as it would have.
//!
//! A file holds who it belongs to ([`Identity`]: settings and a digest of everything the training sees), how far the
//! training is, its records, the state of everything that it changes (parameters, both moments of Adam, the occupancy
//! grid), and the SHA-256 of all that. Random numbers need no state: they follow from the seed and the iteration. It is
//! written under another name and then put into place, so that a killed run leaves the last whole one.

mod error;
mod file;
mod hashing;
mod identity;
mod options;
mod reached;

pub use error::TrainingCheckpointError;
pub use file::Checkpoint;
pub use identity::{Identity, SceneDigest};
pub use options::CheckpointOptions;
pub use reached::Reached;
