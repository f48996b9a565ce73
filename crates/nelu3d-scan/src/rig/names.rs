//! Names in a rig: they become names of files and folders, and must not lead out of it.

/// Longest name, bytes: file systems take 255, and results add endings and temporary numbers.
const LONGEST: usize = 200;

/// What a name must be, for messages.
pub(crate) const NAME_RULE: &str = "it becomes the name of a file: use letters, digits, - and _, and no path";

/// Returns whether a word can be the name of a file or folder in a rig: one part of a path, not hidden, without control
/// characters or spaces around it, of at most 200 bytes.
pub(crate) fn is_name(word: &str) -> bool {
    let odd = |c: char| ['/', '\\', ':'].contains(&c) || c.is_control();
    !word.is_empty() && word.len() <= LONGEST && !word.starts_with('.') && !word.contains(odd) && word.trim() == word
}

/// Returns whether this is the name of a file in a folder of images, or below it: names between slashes.
pub(super) fn is_file_name(path: &str) -> bool {
    path.split('/').all(is_name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_lead_out() {
        for good in ["a", "sine_00.png", "größe 3", "a..b", "x-1"] {
            assert!(is_name(good) && is_file_name(good), "{good}");
        }
        for bad in ["", ".", "..", "../a", "a/../b", "/dev/zero", "C:\\a", "a\\b", ".hidden", " a", "a\nb", "a\0b"] {
            assert!(!is_name(bad) && !is_file_name(bad), "{bad:?}");
        }
        assert!(is_file_name("left/sine.png") && !is_name("left/sine.png"));
        assert!(!is_file_name("left//sine.png") && !is_name(&"a".repeat(201)));
    }
}
