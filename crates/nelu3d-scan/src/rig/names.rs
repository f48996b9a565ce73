//! Names in a rig: they become names of files and folders, and must not lead out of it.

/// Longest name, bytes: file systems take 255, and results add endings and temporary numbers.
const LONGEST: usize = 200;

/// What a name in a rig must be ([`is_name`]), for messages.
pub const NAME_RULE: &str = "it becomes the name of a file: use letters, digits, - and _, and no path";

/// Returns whether a word can be the name of a file or folder in a rig: one part of a path, not hidden, without control
/// characters or spaces around it, of at most 200 bytes.
pub fn is_name(word: &str) -> bool {
    let odd = |c: char| ['/', '\\', ':'].contains(&c) || c.is_control();
    !word.is_empty() && word.len() <= LONGEST && !word.starts_with('.') && !word.contains(odd) && word.trim() == word
}

/// Returns whether this is the name of a file in a folder of images, or below it: names as of [`is_name`] between
/// slashes.
pub fn is_file_name(path: &str) -> bool {
    path.split('/').all(is_name)
}
