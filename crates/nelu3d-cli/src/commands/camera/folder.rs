//! The images of a folder that is no rig.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use nelu3d_scan::rig::natural_order;

use crate::paths::shown;

/// Endings of images that are read.
pub(super) const ENDINGS: [&str; 6] = ["png", "tif", "tiff", "exr", "jpg", "jpeg"];

/// Returns the images of a folder, sorted by name.
pub(super) fn images(dir: &Path) -> Result<Vec<(String, PathBuf)>> {
    let entries = std::fs::read_dir(dir).with_context(|| format!("{}: cannot be read", shown(dir)))?;
    let mut images = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| format!("{}: cannot be read", shown(dir)))?.path();
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if ENDINGS.contains(&ending.as_str()) && !name.starts_with('.') {
            images.push((name, path));
        }
    }
    images.sort_by(|a, b| natural_order(&a.0, &b.0));
    if images.is_empty() {
        bail!("{}: has no images; put PNG, JPEG, TIFF or OpenEXR images there", shown(dir));
    }
    Ok(images)
}
