//! `nelu3d evaluate`: how good a result is.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Result, bail};
use nelu3d::evaluate::{Judged, Truth, compare, evaluate};
use nelu3d::result::Saved;
use nelu3d_scan::camera::read_projector;
use nelu3d_scan::{Projector, Rig};

use super::{Context, shown};
use crate::args;

/// Runs the command.
pub(crate) fn run(args: args::Evaluate, context: &Context) -> Result<ExitCode> {
    let result = Saved::read(&args.result)?;
    match (&args.truth, &args.against) {
        (Some(truth), _) => {
            let projector = projector(args.projector.as_deref(), args.rig.as_deref())?;
            against_truth(&args.result, &result, truth, projector.as_ref(), context)?;
        }
        (None, Some(other)) => against_result(&args.result, &result, other, context)?,
        (None, None) => unreachable!("clap requires one of the two"),
    }
    Ok(ExitCode::SUCCESS)
}

fn against_truth(
    path: &Path,
    result: &Saved,
    truth_dir: &Path,
    projector: Option<&Projector>,
    context: &Context,
) -> Result<()> {
    let truth = Truth::read(truth_dir, &result.camera)?;
    let judged = Judged { depth: &result.depth, normals: result.normals.as_deref(), sigma: result.sigma.as_deref() };
    let metrics = evaluate(&judged, &truth, &truth.regions(&result.camera), &result.camera, projector);
    context
        .answer(&serde_json::json!({ "result": path, "truth": truth_dir, "metrics": metrics }), || metrics.to_string())
}

fn against_result(path: &Path, result: &Saved, other_path: &Path, context: &Context) -> Result<()> {
    let other = Saved::read(other_path)?;
    let size = |r: &Saved| (r.camera.width, r.camera.height);
    if size(result) != size(&other) {
        let ((w, h), (ow, oh)) = (size(result), size(&other));
        bail!(
            "{} has {w} × {h} pixels and {} has {ow} × {oh}: only results of the same camera can be compared",
            shown(path),
            shown(other_path)
        );
    }
    let comparison = compare(&result.depth, &other.depth);
    context.answer(&serde_json::json!({ "result": path, "against": other_path, "comparison": comparison }), || {
        comparison.to_string()
    })
}

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
