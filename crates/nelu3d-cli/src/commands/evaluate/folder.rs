//! The folder that a comparison leaves: whole or absent.
//!
//! | file | content |
//! |---|---|
//! | `alignment.json`, or `comparison.json` | the numbers, as `--json` prints them |
//! | `distances.npy` | float32, height × width, mm, NaN = none |
//! | `error.ply` | the result's surface, colored by them |
//! | `histogram.svg` | how many points have which |
//! | `report.html` | all of it for people |

use std::path::Path;

use anyhow::Result;
use nelu3d::result::picture::color_at;
use nelu3d_scan::output::{OutputDir, write_atomic};
use nelu3d_scan::statistics::percentile;
use nelu3d_scan::{Mesh, npy};
use serde_json::Value;

use crate::context::CommandContext;
use crate::paths::shown;
use nelu3d_report::{ComparisonReport, DIFFERENCE_COLORS};

/// What goes into the folder of a comparison.
pub(super) struct ComparisonFolder<'a> {
    /// Name of the file of the numbers, which also marks the folder as one of ours.
    pub(super) json_name: &'a str,
    /// The numbers.
    pub(super) json: &'a Value,
    /// The page, with the maps and the surface.
    pub(super) report: ComparisonReport<'a>,
}

/// Writes the folder.
pub(super) fn write(dir: &Path, content: &ComparisonFolder<'_>, context: &CommandContext) -> Result<()> {
    context.progress.stage("write the comparison");
    let folder = OutputDir::create(dir, content.json_name)?;
    let at = |name: &str| folder.path().join(name);
    let report = &content.report;
    npy::write(&at("distances.npy"), &[report.size[1], report.size[0]], report.map)?;
    report.mesh.write(&at("error.ply"))?;
    write_atomic(&at("histogram.svg"), |w| w.write_all(report.histogram().as_file().as_bytes()))?;
    write_atomic(&at("report.html"), |w| w.write_all(report.html().as_bytes()))?;
    write_atomic(&at(content.json_name), |w| Ok(serde_json::to_writer_pretty(w, content.json)?))?;
    context.stop_if_asked()?;
    Ok(folder.commit()?)
}

/// Returns the range of the colors: as far from zero on both sides as 95 % of the values reach.
pub(super) fn range(values: &[f64]) -> [f64; 2] {
    let p95 = percentile(&mut values.iter().map(|v| v.abs()).collect::<Vec<_>>(), 95.0);
    if p95 > 0.0 { [-p95, p95] } else { [-1.0, 1.0] }
}

/// Reads the surface of a result and colors it by a value at each of its vertices; gray where there is none.
pub(super) fn colored(result: &Path, at: &dyn Fn(&[f32; 3]) -> Option<f64>, range: [f64; 2]) -> Result<Mesh> {
    let mut mesh = Mesh::read(&result.join("mesh.ply"))?;
    let color = |v: &[f32; 3]| match at(v) {
        Some(d) if d.is_finite() => color_at(DIFFERENCE_COLORS, d, range),
        _ => [110; 3],
    };
    mesh.colors = mesh.vertices.iter().map(color).collect();
    Ok(mesh)
}

/// Returns the last lines of the answer.
pub(super) fn said(output: Option<&Path>) -> String {
    output.map(|dir| format!("report  {}\n", shown(&dir.join("report.html")))).unwrap_or_default()
}

/// Returns the last part of a path, for titles.
pub(super) fn name(path: &Path) -> String {
    path.file_name().map_or_else(|| shown(path), |n| n.to_string_lossy().into_owned())
}
