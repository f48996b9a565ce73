//! `nelu3d evaluate`: how good a result is.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Result, bail};
use nelu3d::result::SavedResult;
use nelu3d_evaluate::{EvaluatedMaps, GroundTruth, compare, evaluate};
use nelu3d_scan::camera::read_projector;
use nelu3d_scan::{Projector, Rig};

use super::{Context, shown};
use crate::args;

mod cad;
mod folder;

/// Runs the command.
pub(crate) fn run(args: args::Evaluate, context: &Context) -> Result<ExitCode> {
    let result = SavedResult::read(&args.result)?;
    let output = args.output.as_deref();
    match (&args.truth, &args.against, &args.cad) {
        (Some(truth), ..) => {
            let projector = projector(args.projector.as_deref(), args.rig.as_deref())?;
            against_truth(&args.result, &result, truth, projector.as_ref(), context)?;
        }
        (None, Some(other), _) => against_result(&args.result, &result, other, output, context)?,
        (None, None, Some(mesh)) => cad::run(&args, mesh, &result, context)?,
        (None, None, None) => unreachable!("clap requires one of the three"),
    }
    Ok(ExitCode::SUCCESS)
}

fn against_truth(
    path: &Path,
    result: &SavedResult,
    truth_dir: &Path,
    projector: Option<&Projector>,
    context: &Context,
) -> Result<()> {
    let truth = GroundTruth::read(truth_dir, &result.camera)?;
    let judged =
        EvaluatedMaps { depth: &result.depth, normals: result.normals.as_deref(), sigma: result.sigma.as_deref() };
    let metrics = evaluate(&judged, &truth, &truth.regions(&result.camera), &result.camera, projector);
    context
        .answer(&serde_json::json!({ "result": path, "truth": truth_dir, "metrics": metrics }), || metrics.to_string())
}

fn against_result(
    path: &Path,
    result: &SavedResult,
    other_path: &Path,
    output: Option<&Path>,
    context: &Context,
) -> Result<()> {
    let other = SavedResult::read(other_path)?;
    let size = |r: &SavedResult| (r.camera.width, r.camera.height);
    if size(result) != size(&other) {
        let ((w, h), (ow, oh)) = (size(result), size(&other));
        bail!(
            "{} has {w} × {h} pixels and {} has {ow} × {oh}: only results of the same camera can be compared",
            shown(path),
            shown(other_path)
        );
    }
    let comparison = compare(&result.depth, &other.depth);
    let json = serde_json::json!({ "result": path, "against": other_path, "comparison": comparison });
    if let Some(output) = output {
        let differences: Vec<f32> = result.depth.iter().zip(&other.depth).map(|(a, b)| a - b).collect();
        let inside: Vec<f64> = differences.iter().filter(|d| d.is_finite()).map(|&d| f64::from(d)).collect();
        let range = folder::range(&inside);
        // At a vertex: the difference of the pixel that it came from.
        let camera = &result.camera;
        let at = |v: &[f32; 3]| {
            let [x, y] = camera.project(&v.map(f64::from).into())?.map(f64::round);
            let inside = x >= 0.0 && y >= 0.0 && x < camera.width as f64 && y < camera.height as f64;
            inside.then(|| f64::from(differences[y as usize * camera.width + x as usize]))
        };
        let d = &comparison.depth_mm;
        let numbers = [
            ("pixels both have", comparison.n.to_string()),
            ("only the first has", comparison.n_only_first.to_string()),
            ("only the second has", comparison.n_only_second.to_string()),
            ("mean |difference|, mm", format!("{:.3}", d.mae)),
            ("median, mm", format!("{:.3}", d.median)),
            ("RMS, mm", format!("{:.3}", d.rmse)),
            ("95th percentile, mm", format!("{:.3}", d.p95)),
            ("first − second, mm", format!("{:+.3}", d.bias)),
        ];
        let rows: Vec<Vec<String>> = numbers.iter().map(|(k, v)| vec![(*k).to_owned(), v.clone()]).collect();
        folder::write(
            output,
            &folder::Content {
                json_name: "comparison.json",
                json: &json,
                page: crate::report::Differences {
                    title: format!("{} against {}", folder::name(path), folder::name(other_path)),
                    subtitle: "depth of the first − depth of the second, mm".to_owned(),
                    tiles: vec![
                        (format!("{:.3} mm", d.median), "median |difference|".to_owned()),
                        (format!("{:.3} mm", d.mae), "mean |difference|".to_owned()),
                        (format!("{:.3} mm", d.p95), "95th percentile".to_owned()),
                        (format!("{:+.3} mm", d.bias), "mean difference".to_owned()),
                    ],
                    quantity: "Difference",
                    map: &differences,
                    size: [camera.width, camera.height],
                    range,
                    histogram_of: &inside,
                    mesh: folder::colored(path, &at, range)?,
                    tables: vec![("Numbers", vec!["", ""], rows)],
                },
            },
            context,
        )?;
    }
    context.answer(&json, || comparison.to_string() + &folder::said(output))
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
