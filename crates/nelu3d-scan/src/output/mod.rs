//! Files and folders that are either whole or absent: written under a temporary name beside their place, then renamed.
//!
//! [`write_atomic`] and [`AtomicFile`] are for files, [`OutputDir`] for folders of files. What a killed run has left
//! under a temporary name is removed when the same file or folder is written again: who is at work on it holds a lock,
//! which the system takes back however he ends.

mod file;
mod folder;
mod parents;
mod partial;
mod swap;

pub use file::{AtomicFile, ReservedPath, write_atomic};
pub use folder::{OutputDir, remove_abandoned};
pub use parents::{create_dir, link_or_copy};
pub use partial::{explain as write_error, remove_partial};
pub use swap::exchange as exchange_folders;
