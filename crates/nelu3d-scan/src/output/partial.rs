//! What is under construction in this process, and errors that name what it will be.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// How the names of files under construction end.
pub(super) const SUFFIX: &str = ".partial";

/// A file or folder under construction.
#[derive(Clone, Debug)]
struct Entry {
    /// Its temporary name.
    temp: PathBuf,
    /// The name that it will have.
    target: PathBuf,
}

/// What is under construction in this process.
static PARTIAL: Mutex<Vec<Entry>> = Mutex::new(Vec::new());

fn entries() -> std::sync::MutexGuard<'static, Vec<Entry>> {
    PARTIAL.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Notes a temporary name until it is dropped, for [`remove_partial`] and [`explain`].
#[derive(Debug)]
pub(super) struct Partial(PathBuf);

impl Partial {
    pub(super) fn new(temp: &Path, target: &Path) -> Self {
        entries().push(Entry { temp: temp.to_path_buf(), target: target.to_path_buf() });
        Self(temp.to_path_buf())
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        entries().retain(|e| e.temp != self.0);
    }
}

/// Removes everything that this process has under construction: for a program that ends on the spot, without unwinding.
/// Work that goes on in other threads will fail to write.
pub fn remove_partial() {
    for Entry { temp, .. } in entries().drain(..) {
        let _ = if temp.is_dir() { fs::remove_dir_all(&temp) } else { fs::remove_file(&temp) };
    }
}

/// Returns the path that a file will have for whoever reads it: a folder under construction has a name of its own.
fn final_path(path: &Path) -> PathBuf {
    let entries = entries();
    let moved = entries.iter().find_map(|e| path.strip_prefix(&e.temp).ok().map(|rest| e.target.join(rest)));
    moved.unwrap_or_else(|| path.to_path_buf())
}

/// Returns an error of writing `path` with the path and a remedy in its message. A path in something under construction
/// in this process is told as it will be: whoever reads the message never sees the temporary name.
pub fn explain(path: &Path, e: &io::Error) -> io::Error {
    let remedy = match e.kind() {
        io::ErrorKind::NotFound => "; create its folder first",
        io::ErrorKind::PermissionDenied => "; choose a folder you may write to, or change its permissions",
        io::ErrorKind::ReadOnlyFilesystem => "; choose a folder on a writable disk",
        io::ErrorKind::StorageFull => "; free space on that disk, or write to another",
        io::ErrorKind::QuotaExceeded => "; free some of your quota on that disk, or write to another",
        io::ErrorKind::IsADirectory => "; a folder has this name: move it away, or choose another name",
        io::ErrorKind::NotADirectory => "; a part of this path is a file, not a folder: choose another path",
        io::ErrorKind::InvalidFilename => "; choose a shorter name, without odd characters",
        _ => "",
    };
    let text = e.to_string();
    // The crate that makes temporary files names them; they mean nothing to whoever reads this.
    let text = text.split(" at path \"").next().unwrap_or_default();
    io::Error::new(e.kind(), format!("{}: cannot be written: {text}{remedy}", final_path(path).display()))
}
