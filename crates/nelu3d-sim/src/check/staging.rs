//! Checks of what stands in a scene besides its objects, and of bumps.

use super::rules::check;
use crate::spec::{SceneSpec, Spec, SpecError};
use crate::sweep::try_sweep_poses;

/// Largest bump, px: beyond it, the light may leave what it should fall on.
const MAX_PX: f64 = 1000.0;

/// Checks the board of a scene and its bump.
pub(super) fn check_staging(spec: &Spec, scene: &SceneSpec) -> Result<(), SpecError> {
    let key = |what: &str| format!("scenes `{}`.{what}", scene.name);
    if let Some(position) = &scene.board {
        let known = try_sweep_poses(spec).is_ok_and(|poses| poses.iter().any(|p| p.position == *position));
        check(known, key("board"), format!("\"{position}\""), "name a position of the sweep, as \"000\"")?;
    }
    let empty = scene.objects.is_empty() && scene.board.is_none();
    check(!empty, key("objects"), "none", "give the scene an object, or a board")?;
    for (what, px) in scene.bump.iter().flat_map(|b| [("bump.camera_px", b.camera_px), ("bump.light_px", b.light_px)]) {
        let good = px.iter().all(|v| v.abs() <= MAX_PX);
        check(good, key(what), format!("{px:?}"), "give two numbers of at most 1000 px")?;
    }
    Ok(())
}
