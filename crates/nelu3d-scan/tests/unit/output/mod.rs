mod file;
mod folder;
mod partial;

/// Returns the names of everything in a folder, sorted.
pub(crate) fn names(dir: &std::path::Path) -> Vec<String> {
    let name = |e: std::io::Result<std::fs::DirEntry>| e.unwrap().file_name().to_string_lossy().into_owned();
    let mut all: Vec<String> = std::fs::read_dir(dir).unwrap().map(name).collect();
    all.sort();
    all
}
