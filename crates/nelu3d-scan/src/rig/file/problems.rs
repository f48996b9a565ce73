//! What is wrong with rig.toml, collected.

use std::path::PathBuf;

use crate::input::shortened;
use crate::rig::names::is_file_name;
use crate::rig::{NAME_RULE, RigError, is_name};

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

    /// Adds a problem if a name cannot be that of a file or folder in the rig.
    pub(super) fn expect_name(&mut self, key: &str, name: &str) {
        self.expect_named(is_name(name), key, name, NAME_RULE);
    }

    /// Adds a problem if this is not the name of an image in every folder, or below it.
    pub(super) fn expect_image(&mut self, key: &str, name: &str) -> bool {
        let remedy = "give the name of a file that lies in every position's and scene's folder, as white.png";
        self.expect_named(is_file_name(name), key, name, remedy)
    }

    fn expect_named(&mut self, good: bool, key: &str, name: &str, remedy: &str) -> bool {
        if name.trim().is_empty() {
            return self.expect(false, key, "is empty", "give a name");
        }
        self.expect(good, key, format!("is \"{}\"", shortened(name)), remedy)
    }
}
