//! The frames of a recording: which files, in which order, and whether one is missing.

use std::path::{Path, PathBuf};

use super::ImportError;
use crate::rig::natural_order;

/// Endings of the frames' names.
const ENDINGS: [&str; 4] = ["png", "tif", "tiff", "dng"];

/// Returns the frames `first..=last` (counted from 1) of a folder, in the order of their names, numbers by value.
pub(super) fn list(dir: &Path, first: Option<usize>, last: Option<usize>) -> Result<Vec<PathBuf>, ImportError> {
    let io = |source| ImportError::Io { path: dir.to_path_buf(), source };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        // Hidden files are other programs' notes, `._frame_000001.dng` of macOS for one.
        if ENDINGS.contains(&ending(&path).as_str()) && !name.starts_with('.') && path.is_file() {
            names.push((name, path));
        }
    }
    names.sort_by(|a, b| natural_order(&a.0, &b.0));
    let all: Vec<PathBuf> = names.into_iter().map(|(_, path)| path).collect();
    let Some(head) = all.first() else {
        return Err(ImportError::unfit(
            dir,
            "has no frames (.png, .tif, .tiff or .dng)",
            "give the folder that holds them; a film becomes one with: ffmpeg -i FILM FOLDER/%06d.png",
        ));
    };
    // .tif and .tiff are the same.
    let kind = |path: &Path| ending(path).replace("tiff", "tif");
    if let Some(other) = all.iter().find(|path| kind(path) != kind(head)) {
        return Err(ImportError::unfit(
            dir,
            format!("has frames of two kinds, {} and {}", file_name(head), file_name(other)),
            "put each recording into a folder of its own",
        ));
    }
    let (from, to) = (first.unwrap_or(1), last.unwrap_or(all.len()));
    if from == 0 || from > to || to > all.len() {
        return Err(ImportError::unfit(
            dir,
            format!("has frames 1 to {}, not {from} to {to}", all.len()),
            "correct --first and --last, which count from 1 in the order of the names",
        ));
    }
    Ok(all[from - 1..to].to_vec())
}

/// Fails if the numbers in the names jump in a way that would shift all later frames to another place in their
/// group: a frame that was lost in copying, say. Names without a regular numbering (times, say) tell nothing.
pub(super) fn check_numbers(frames: &[PathBuf], group: usize) -> Result<(), ImportError> {
    let Some(numbers) = frames.iter().map(|f| number(f)).collect::<Option<Vec<_>>>() else { return Ok(()) };
    let steps: Vec<u64> = numbers.windows(2).map(|w| w[1].saturating_sub(w[0])).collect();
    let Some(&step) = steps.iter().min().filter(|&&s| s > 0) else { return Ok(()) };
    if steps.iter().any(|s| s % step != 0) {
        return Ok(());
    }
    match steps.iter().position(|s| (s / step - 1) % group as u64 != 0) {
        None => Ok(()),
        Some(i) => Err(ImportError::unfit(
            &frames[i + 1],
            format!("follows {}: {} missing between them", file_name(&frames[i]), amount(steps[i] / step - 1)),
            "all later frames would be taken for others; copy the recording again, or import what is before and after \
             the gap apart, with --first and --last",
        )),
    }
}

fn amount(n: u64) -> String {
    if n == 1 { "a frame is".into() } else { format!("{n} frames are") }
}

/// Returns the last number in a file's name.
fn number(path: &Path) -> Option<u64> {
    let stem = path.file_stem()?.to_str()?;
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |i| i + 1);
    // A name may hold any character before its number, of any length.
    stem.get(start..end)?.parse().ok()
}

pub(super) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns the ending of a name, in small letters.
pub(super) fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}
