//! `nelu3d evaluate --cad`: a result against a mesh of the part.

use std::path::Path;

use anyhow::{Result, bail};
use nalgebra::Isometry3;
use nelu3d::result::SavedResult;
use nelu3d_evaluate::cad::{CadError, CadMetrics, CadOptions, Scan, Start, compare_with_cad, read_pose};
use nelu3d_scan::Mesh;

use super::folder;
use crate::args;
use crate::commands::{Context, shown};
use crate::report::Differences;

pub(super) fn run(args: &args::Evaluate, path: &Path, result: &SavedResult, context: &Context) -> Result<()> {
    let mesh = Mesh::read(path)?;
    let pose = args.initial_pose.as_deref().map(read_pose).transpose()?;
    let start = match (pose, args.no_align) {
        (pose, true) => Start::Fixed(pose.unwrap_or_else(Isometry3::identity)),
        (Some(pose), false) => Start::Near(pose),
        (None, false) => Start::Search,
    };
    let options = CadOptions { scale: args.scale, start, within_mm: args.within, ..CadOptions::default() };
    let scan = Scan { camera: &result.camera, depth: &result.depth, normals: result.normals.as_deref() };
    let found = match compare_with_cad(&scan, &mesh, &options, &context.progress) {
        Ok(found) => found,
        // The library has a mesh and maps, not files.
        Err(e @ CadError::EmptyScan { .. }) => bail!("{}: {e}", shown(&args.result)),
        Err(e) => bail!("{}: {e}", shown(path)),
    };
    let m = &found.metrics;
    let of_part = |d: &&f32| f64::from(**d).abs() <= m.within_mm;
    let inside: Vec<f64> = found.distances.iter().filter(of_part).map(|&d| f64::from(d)).collect();
    let range = folder::range(&inside);
    let json = serde_json::json!({
        "result": args.result,
        "cad": path,
        "cam_from_cad": m.cam_from_cad,
        "metrics": m,
        "color_scale_mm": range,
    });
    if let Some(output) = &args.output {
        let at = |v: &[f32; 3]| Some(found.surface.signed_distance(&found.pose, &v.map(f64::from).into()));
        let pose = m.cam_from_cad.iter().map(|r| r.iter().map(|v| format!("{v:.6}")).collect()).collect();
        let content = folder::Content {
            json_name: "alignment.json",
            json: &json,
            page: Differences {
                title: format!("{} against {}", folder::name(&args.result), folder::name(path)),
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
                histogram_of: &inside,
                mesh: folder::colored(&args.result, &at, range)?,
                tables: vec![
                    ("Distances", CadMetrics::headings().to_vec(), m.rows()),
                    ("Pose: cam_from_cad", vec!["x", "y", "z", "mm"], pose),
                ],
            },
        };
        folder::write(output, &content, context)?;
    }
    context.answer(&json, || m.to_string() + &folder::said(args.output.as_deref()))
}

fn tiles(m: &CadMetrics) -> Vec<(String, String)> {
    let share = |v: f64| format!("{:.1} %", 100.0 * v);
    vec![
        (format!("{:.3} mm", m.body.distance_mm.median), "median |distance|, body".to_owned()),
        (format!("{:.3} mm", m.part.distance_mm.mae), "mean |distance|, part".to_owned()),
        (format!("{:.3} mm", m.part.distance_mm.p95), "95th percentile, part".to_owned()),
        (format!("{:+.3} mm", m.part.distance_mm.bias), "mean signed distance".to_owned()),
        (share(m.part.under_half_mm), "of the part closer than 0.5 mm".to_owned()),
        (share(m.inliers), format!("of the points within {:.2} mm", m.within_mm)),
        (share(m.visible_found), "of the visible mesh found".to_owned()),
    ]
}
