//! `nelu3d evaluate --cad`: a result against a mesh of the part.

use std::path::Path;

use anyhow::Result;
use nalgebra::Isometry3;
use nelu3d::result::SavedResult;
use nelu3d_evaluate::cad::{
    CadComparison, CadError, CadMetrics, CadOptions, InitialPose, ScanMaps, compare_with_cad, read_pose,
};
use nelu3d_scan::Mesh;

use super::folder::{self, ComparisonFolder};
use crate::args::EvaluateArgs;
use crate::context::CommandContext;
use crate::paths::shown;
use nelu3d_report::ComparisonReport;

/// Compares a result with a mesh of the part.
pub(super) fn run(args: &EvaluateArgs, path: &Path, result: &SavedResult, context: &CommandContext) -> Result<()> {
    let mesh = Mesh::read(path)?;
    let pose = args.initial_pose.as_deref().map(read_pose).transpose()?;
    let start = match (pose, args.no_align) {
        (pose, true) => InitialPose::Fixed(pose.unwrap_or_else(Isometry3::identity)),
        (Some(pose), false) => InitialPose::Near(pose),
        (None, false) => InitialPose::Search,
    };
    let options = CadOptions { scale: args.scale, start, within_mm: args.within, ..CadOptions::default() };
    let scan = ScanMaps { camera: &result.camera, depth: &result.depth, normals: result.normals.as_deref() };
    // The library has a mesh and maps, not files.
    let found = compare_with_cad(&scan, &mesh, &options, &context.progress).map_err(|e| {
        let file = if matches!(e, CadError::EmptyScan { .. }) { &args.result } else { path };
        anyhow::Error::from(e).context(shown(file))
    })?;
    let m = &found.metrics;
    let of_part = |d: &&f32| f64::from(**d).abs() <= m.within_mm;
    let distances: Vec<f64> = found.distances.iter().filter(of_part).map(|&d| f64::from(d)).collect();
    let range = folder::range(&distances);
    let json = serde_json::json!({
        "result": shown(&args.result),
        "cad": shown(path),
        "cam_from_cad": m.cam_from_cad,
        "metrics": m,
        "color_scale_mm": range,
    });
    if let Some(output) = &args.output {
        let report = report(&found, [&args.result, path], result, &distances, range)?;
        folder::write(output, &ComparisonFolder { json_name: "alignment.json", json: &json, report }, context)?;
    }
    context.answer(&json, || m.to_string() + &folder::said(args.output.as_deref()))
}

/// Describes the page of a comparison; `of_part` are the distances of the points that belong to the part.
fn report<'a>(
    found: &'a CadComparison,
    [path, mesh_path]: [&Path; 2],
    result: &SavedResult,
    of_part: &'a [f64],
    range: [f64; 2],
) -> Result<ComparisonReport<'a>> {
    let m = &found.metrics;
    let at = |v: &[f32; 3]| Some(found.surface.signed_distance(&found.pose, &v.map(f64::from).into()));
    let pose = m.cam_from_cad.iter().map(|r| r.iter().map(|v| format!("{v:.6}")).collect()).collect();
    Ok(ComparisonReport {
        title: format!("{} against {}", folder::name(path), folder::name(mesh_path)),
        subtitle: format!(
            "signed distance from the mesh, {}; mesh of {:.1} mm across, {}",
            if m.closed { "positive outside" } else { "positive on the camera's side" },
            m.cad_diagonal_mm,
            if m.aligned { "aligned to the scan" } else { "where it was given" }
        ),
        tiles: tiles(m),
        quantity: "Distance",
        map: &found.distances,
        size: [result.camera.width, result.camera.height],
        range,
        histogram_of: of_part,
        mesh: folder::colored(path, &at, range)?,
        tables: vec![
            ("Distances", CadMetrics::headings().to_vec(), m.rows()),
            ("Pose: cam_from_cad", vec!["x", "y", "z", "mm"], pose),
        ],
    })
}

/// Returns the numbers one looks for first.
fn tiles(m: &CadMetrics) -> Vec<(String, String)> {
    let percent = |v: f64| format!("{:.1} %", 100.0 * v);
    vec![
        (format!("{:.3} mm", m.body.distance_mm.median), "median |distance|, body".to_owned()),
        (format!("{:.3} mm", m.part.distance_mm.mae), "mean |distance|, part".to_owned()),
        (format!("{:.3} mm", m.part.distance_mm.p95), "95th percentile, part".to_owned()),
        (format!("{:+.3} mm", m.part.distance_mm.bias), "mean signed distance".to_owned()),
        (percent(m.part.under_half_mm), "of the part closer than 0.5 mm".to_owned()),
        (percent(m.inliers), format!("of the points within {:.2} mm", m.within_mm)),
        (percent(m.visible_found), "of the visible mesh found".to_owned()),
    ]
}
