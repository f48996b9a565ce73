//! Symbolic links that became text files.
//!
//! Git on systems without symbolic links, and some archives, leave a file that holds the link's target and nothing
//! else. A scene that shows a board of the sweep is often made of such links.

use std::io::Read;
use std::path::{Path, PathBuf};

use crate::input::open_file;

/// Longest content that may be a link's target, bytes.
const LONGEST: u64 = 1024;

/// Returns the file that a text file in a link's place names, relative to its folder; `None` for any other file.
pub(super) fn target(path: &Path) -> Option<PathBuf> {
    let (file, size) = open_file(path).ok()?;
    if size == 0 || size > LONGEST {
        return None;
    }
    let mut text = String::new();
    file.take(LONGEST).read_to_string(&mut text).ok()?;
    let target = Path::new(&text);
    // A name without a folder is a note, not a link; links have no line's end.
    let is_link = !text.contains(char::is_control) && text.contains('/') && target.is_relative();
    (is_link && target.extension() == path.extension()).then(|| path.parent().unwrap_or(Path::new("")).join(target))
}
