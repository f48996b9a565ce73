//! Folders on the way to an output, and files that are taken over as they are.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::partial::explain;

/// Folders created on the way to an output, outermost first. Those that are still empty when it is dropped are removed.
#[derive(Debug)]
pub(super) struct Parents(Vec<PathBuf>);

impl Parents {
    pub(super) fn create(dir: &Path) -> io::Result<Self> {
        let missing = |d: &&Path| !d.as_os_str().is_empty() && !d.exists();
        let mut folders = Self(dir.ancestors().take_while(missing).map(Path::to_path_buf).collect());
        folders.0.reverse();
        // The system would only say that something exists.
        let above = dir.ancestors().find(|d| d.exists());
        if above.is_some_and(|d| !d.is_dir()) {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        fs::create_dir_all(dir)?;
        Ok(folders)
    }
}

impl Drop for Parents {
    fn drop(&mut self) {
        for dir in self.0.iter().rev() {
            // Fails, as it should, for a folder that holds something.
            let _ = fs::remove_dir(dir);
        }
    }
}

/// Creates a folder and its parents, if it is not there.
///
/// # Errors
///
/// The file system refuses; the message names `path` and, where one is known, a remedy.
pub fn create_dir(path: &Path) -> io::Result<()> {
    fs::create_dir_all(path).map_err(|e| explain(path, &e))
}

/// Gives the file `from` a second name, without a copy. Where the disk has no such thing, or is another, it is copied.
///
/// # Errors
///
/// `from` cannot be read or `to` not written; the message names one of them.
pub fn link_or_copy(from: &Path, to: &Path) -> io::Result<()> {
    // The link itself would be linked, and may be relative.
    let from = fs::canonicalize(from)?;
    if fs::hard_link(&from, to).is_ok() {
        return Ok(());
    }
    fs::copy(&from, to).map(|_| ()).map_err(|e| explain(to, &e))
}
