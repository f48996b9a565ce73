//! Which pattern set has a code along both axes of the projected image.

use nelu3d_scan::Rig;
use nelu3d_scan::rig::{PatternSet, RIG_FILE};

use super::error::ProjectorError;
use crate::code::{Code, ProjectedLight};
use crate::gray::GrayTable;

/// Finds the set to decode; returns it, its code, and the size of the projected image.
pub(super) fn coded_set<'a>(
    rig: &'a Rig,
    name: Option<&str>,
) -> Result<(&'a PatternSet, Code, [usize; 2]), ProjectorError> {
    let both = |set: &'a PatternSet| -> Result<(&'a PatternSet, Code, [usize; 2]), ProjectorError> {
        let code = Code::read_sized(rig, set, None, &ProjectedLight::Power(1.0))?;
        let [x, y] = &code.axes[..] else {
            return Err(ProjectorError::needs(
                rig.root.join(RIG_FILE),
                format!("set `{}` has a code along one axis only", set.name),
                "give a set with a binary code along x and one along y",
            ));
        };
        GrayTable::new(x, set)?;
        GrayTable::new(y, set)?;
        let size = [x.len(), y.len()];
        Ok((set, code, size))
    };
    if let Some(name) = name {
        return both(rig.pattern_set(Some(name))?);
    }
    rig.pattern_sets.iter().find_map(|set| both(set).ok()).ok_or_else(|| {
        ProjectorError::needs(
            rig.root.join(RIG_FILE),
            "no pattern set has binary codes along x and along y, with its projected images in patterns/",
            "capture the sweep with Gray code along both axes (sets of one axis alone can be joined to one set)",
        )
    })
}
