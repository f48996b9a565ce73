//! What is wrong with rig.toml, collected.

use std::path::PathBuf;

use crate::rig::RigError;

/// Collects what is wrong with the values of a rig.toml.
pub(super) struct Problems {
    /// The file.
    pub(super) path: PathBuf,
    /// What was found, in order.
    pub(super) found: Vec<RigError>,
}

impl Problems {
    /// Adds a problem unless `good`, and returns `good`.
    pub(super) fn expect(&mut self, good: bool, key: &str, problem: impl Into<String>, remedy: &str) -> bool {
        if !good {
            self.found.push(RigError::Invalid {
                path: self.path.clone(),
                key: key.into(),
                problem: problem.into(),
                remedy: remedy.into(),
            });
        }
        good
    }

    /// Adds a problem if a name is empty.
    pub(super) fn expect_name(&mut self, key: &str, name: &str) {
        self.expect(!name.trim().is_empty(), key, "is empty", "give a name");
    }
}
