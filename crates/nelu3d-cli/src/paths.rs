//! Where things are by default, and the color field that is there.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use nelu3d::ColorField;
use nelu3d::color_field::check_field;
use nelu3d_scan::Rig;
use nelu3d_scan::rig::PatternSet;

/// Returns where `calibrate` writes the color field of a set, and `reconstruct` looks for it.
pub(crate) fn default_field(rig: &Rig, set: &str) -> PathBuf {
    rig.root.join("fields").join(format!("{set}.safetensors"))
}

/// Returns where `reconstruct` writes the result of a scene.
pub(crate) fn default_result(rig: &Rig, scene: &str, set: &str) -> PathBuf {
    rig.root.join("results").join(format!("{scene}-{set}"))
}

/// Loads the color field of a set, which must exist and belong to the rig.
pub(crate) fn load_field(rig: &Rig, set: &PatternSet, path: &Path) -> Result<ColorField> {
    if !path.exists() {
        anyhow::bail!(
            "{}: there is no color field; run `nelu3d calibrate {} --set {}` first, or give one with --field",
            shown(path),
            shown(&rig.root),
            set.name
        );
    }
    let field = ColorField::load(path)?;
    // The library has a field, not a file.
    check_field(rig, set, &field).with_context(|| shown(path))?;
    Ok(field)
}

/// Returns a path as it should be shown.
pub(crate) fn shown(path: &Path) -> String {
    path.display().to_string()
}
