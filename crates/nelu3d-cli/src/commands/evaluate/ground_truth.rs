//! `nelu3d evaluate --truth`: a result against ground truth.

use std::path::Path;

use anyhow::{Result, bail};
use nelu3d::result::SavedResult;
use nelu3d_evaluate::{EvaluatedMaps, GroundTruth, evaluate};
use nelu3d_scan::camera::read_projector;
use nelu3d_scan::{Projector, Rig};

use crate::args::EvaluateArgs;
use crate::context::CommandContext;
use crate::paths::shown;

/// Evaluates a result against the ground truth in a folder.
pub(super) fn run(args: &EvaluateArgs, dir: &Path, result: &SavedResult, context: &CommandContext) -> Result<()> {
    let projector = projector(args.projector.as_deref(), args.rig.as_deref())?;
    let truth = GroundTruth::read(dir, &result.camera)?;
    let maps =
        EvaluatedMaps { depth: &result.depth, normals: result.normals.as_deref(), sigma: result.sigma.as_deref() };
    let metrics = evaluate(&maps, &truth, &truth.regions(&result.camera), &result.camera, projector.as_ref());
    let json = serde_json::json!({ "result": shown(&args.result), "truth": shown(dir), "metrics": metrics });
    context.answer(&json, || metrics.to_string())
}

/// Reads the projector in whose columns errors are measured, from its file or its rig.
fn projector(file: Option<&Path>, rig: Option<&Path>) -> Result<Option<Projector>> {
    if let Some(file) = file {
        return Ok(Some(read_projector(file)?));
    }
    let Some(path) = rig else { return Ok(None) };
    let rig = Rig::open(path)?;
    match rig.projector {
        Some(projector) => Ok(Some(projector)),
        None => bail!("{}: the rig has no projector.json; leave --rig away, or give --projector FILE", shown(path)),
    }
}
