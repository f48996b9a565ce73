//! Whether and where the state of a training is kept.

use std::path::PathBuf;

use super::file::Checkpoint;
use super::identity::Identity;

/// Whether and where the state of a training is kept. Not part of a result's settings: the result does not depend on
/// it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct CheckpointOptions {
    /// Keep the state of the training in this file, and go on from it if it is there: an interrupted training ends with
    /// the result of an uninterrupted one; the file is removed at the end
    #[cfg_attr(feature = "clap", arg(id = "checkpoint", long = "checkpoint", value_name = "FILE"))]
    pub path: Option<PathBuf>,
    /// Number of iterations between two writings of that file (on the CPU; of a GPU's state every half minute, and when
    /// the program is asked to stop)
    #[cfg_attr(feature = "clap", arg(id = "checkpoint-every", long = "checkpoint-every", value_name = "N"))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().every))]
    pub every: usize,
}

impl Default for CheckpointOptions {
    fn default() -> Self {
        Self { path: None, every: 500 }
    }
}

impl CheckpointOptions {
    /// Returns the checkpoint of a training, if one is wanted.
    pub fn of(&self, identity: impl FnOnce() -> Identity) -> Option<Checkpoint> {
        let path = self.path.clone()?;
        Some(Checkpoint::new(path, identity(), self.every))
    }
}
