//! `nelu3d evaluate --against`: a result against another one of the same camera.

use std::path::Path;

use anyhow::{Result, bail};
use nelu3d::result::SavedResult;
use nelu3d_evaluate::{Comparison, compare};
use nelu3d_scan::Camera;

use super::folder::{self, ComparisonFolder};
use crate::args::EvaluateArgs;
use crate::context::CommandContext;
use crate::paths::shown;
use nelu3d_report::ComparisonReport;

/// Compares the depth of two results.
pub(super) fn run(
    args: &EvaluateArgs,
    other_path: &Path,
    result: &SavedResult,
    context: &CommandContext,
) -> Result<()> {
    let (path, output) = (args.result.as_path(), args.output.as_deref());
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
    let json = serde_json::json!({ "result": shown(path), "against": shown(other_path), "comparison": comparison });
    if let Some(output) = output {
        let differences: Vec<f32> = result.depth.iter().zip(&other.depth).map(|(a, b)| a - b).collect();
        let finite: Vec<f64> = differences.iter().filter(|d| d.is_finite()).map(|&d| f64::from(d)).collect();
        let range = folder::range(&finite);
        let report = report(&comparison, [path, other_path], &result.camera, &differences, &finite, range)?;
        folder::write(output, &ComparisonFolder { json_name: "comparison.json", json: &json, report }, context)?;
    }
    context.answer(&json, || comparison.to_string() + &folder::said(output))
}

/// Describes the page of a comparison; `finite` are those of the `differences` that are numbers.
fn report<'a>(
    comparison: &Comparison,
    [path, other_path]: [&Path; 2],
    camera: &Camera,
    differences: &'a [f32],
    finite: &'a [f64],
    range: [f64; 2],
) -> Result<ComparisonReport<'a>> {
    // At a vertex: the difference of the pixel that it came from.
    let at = |v: &[f32; 3]| {
        let [x, y] = camera.project(&v.map(f64::from).into())?.map(f64::round);
        let inside = x >= 0.0 && y >= 0.0 && x < camera.width as f64 && y < camera.height as f64;
        inside.then(|| f64::from(differences[y as usize * camera.width + x as usize]))
    };
    let d = &comparison.depth_mm;
    let numbers = [
        ("valid in both, pixels", comparison.n.to_string()),
        ("only in the first, pixels", comparison.n_only_first.to_string()),
        ("only in the second, pixels", comparison.n_only_second.to_string()),
        ("mean |difference|, mm", format!("{:.3}", d.mae)),
        ("median, mm", format!("{:.3}", d.median)),
        ("RMS, mm", format!("{:.3}", d.rmse)),
        ("95th percentile, mm", format!("{:.3}", d.p95)),
        ("first − second, mm", format!("{:+.3}", d.bias)),
    ];
    let rows: Vec<Vec<String>> = numbers.iter().map(|(k, v)| vec![(*k).to_owned(), v.clone()]).collect();
    Ok(ComparisonReport {
        title: format!("{} against {}", folder::name(path), folder::name(other_path)),
        subtitle: "depth of the first − depth of the second, mm".to_owned(),
        tiles: vec![
            (format!("{:.3} mm", d.median), "median |difference|".to_owned()),
            (format!("{:.3} mm", d.mae), "mean |difference|".to_owned()),
            (format!("{:.3} mm", d.p95), "95th percentile".to_owned()),
            (format!("{:+.3} mm", d.bias), "mean difference".to_owned()),
        ],
        quantity: "Difference",
        map: differences,
        size: [camera.width, camera.height],
        range,
        histogram_of: finite,
        mesh: folder::colored(path, &at, range)?,
        tables: vec![("Numbers", vec!["", ""], rows)],
    })
}
