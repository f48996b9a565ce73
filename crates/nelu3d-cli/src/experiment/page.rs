//! The page of an experiment: tables, plots, and what every method made of every case, side by side.

use std::fmt::Write;

use anyhow::Result;
use nelu3d::result::SavedResult;
use nelu3d::result::picture::{DEPTH_COLORS, Picture, limits};
use nelu3d_evaluate::GroundTruth;
use nelu3d_scan::statistics::percentile;

use super::cell::ExperimentCell;
use super::table::{ExperimentNumbers, TableCell};
use nelu3d_report::html::{color_bar, escape, img, table};
use nelu3d_report::page::{details, page, section};

/// Maximum width of pictures side by side, px.
const MAX_WIDTH: usize = 260;

/// Returns the page. `plots` are charts with their legends, one per main column; `made` says when and where.
pub(super) fn html(
    name: &str,
    numbers: &ExperimentNumbers<'_>,
    plots: &[(String, String)],
    cells: &[ExperimentCell],
    claims: &[String],
    made: &str,
) -> Result<String> {
    let experiment = numbers.experiment;
    let mut body = String::new();
    let mut about = format!("<p>{}</p>", escape(experiment.note.trim()).replace("\n\n", "</p><p>"));
    if !experiment.source.is_empty() {
        about = format!("<p class=note>{}</p>{about}", escape(&experiment.source));
    }
    body += &section("What this is", &about);
    for (i, column) in experiment.columns.iter().enumerate().filter(|(_, c)| c.main) {
        let (headings, rows) = numbers.pivot(i);
        let mut content = pivot(&headings, &rows);
        if let Some((_, svg)) = plots.iter().find(|p| p.0 == column.label) {
            let _ = write!(content, "<figure class=plot>{svg}</figure>");
        }
        body += &section(&column.label, &content);
    }
    if !claims.is_empty() {
        let items = claims.iter().fold(String::new(), |s, c| s + "<li>" + &escape(c) + "</li>");
        body += &section("Claims", &format!("<ul>{items}</ul>"));
    }
    body += &section("Side by side", &pictures(numbers, cells)?);
    let (headings, rows) = numbers.long();
    let headings: Vec<&str> = headings.iter().map(String::as_str).collect();
    body += &details("All numbers", false, &table(&headings, &rows));
    let problems = numbers.problems();
    if !problems.is_empty() {
        let items = problems.iter().fold(String::new(), |s, p| s + "<li>" + &escape(p) + "</li>");
        body += &section("Without a result", &format!("<ul>{items}</ul>"));
    }
    let mut commands: Vec<&String> = Vec::new();
    for command in cells.iter().flat_map(|c| &c.commands) {
        if !commands.contains(&command) {
            commands.push(command);
        }
    }
    let lines = commands.iter().fold(String::new(), |s, c| s + &escape(c) + "\n");
    body += &details("Commands", false, &format!("<pre class=scroll>{lines}</pre>"));
    Ok(page(&experiment.title, &format!("nelu3d experiment {name} · {made}"), &body))
}

/// Shows the table of a main column.
fn pivot(headings: &[String], rows: &[Vec<TableCell>]) -> String {
    let mut html = "<div class=scroll><table><tr>".to_owned();
    for h in headings {
        let _ = write!(html, "<th>{}</th>", escape(h));
    }
    for row in rows {
        html += "</tr><tr>";
        for cell in row {
            let text = escape(&cell.text);
            let _ = if cell.best { write!(html, "<td><b>{text}</b></td>") } else { write!(html, "<td>{text}</td>") };
        }
    }
    html + "</tr></table></div>"
}

/// Shows what each method found on every row with the first seed: depth, and its error where there is ground truth.
fn pictures(numbers: &ExperimentNumbers<'_>, cells: &[ExperimentCell]) -> Result<String> {
    let experiment = numbers.experiment;
    let n_values = experiment.vary.as_ref().map_or(1, |v| v.values.len());
    let mut html = String::new();
    for row in 0..numbers.n_rows() {
        let mut mine: Vec<&ExperimentCell> =
            cells.iter().filter(|c| c.case * n_values + c.value == row && c.document.is_ok()).collect();
        let Some(seed) = mine.iter().map(|c| c.seed).min() else { continue };
        mine.retain(|c| c.seed == seed);
        let results: Vec<SavedResult> = mine.iter().map(|c| SavedResult::read(&c.folder)).collect::<Result<_, _>>()?;
        let truth_dir = mine[0].scene.join("truth");
        let truth = if truth_dir.exists() { Some(GroundTruth::read(&truth_dir, &results[0].camera)?) } else { None };
        // One scale for the whole row: that of the first method's depth, and of the best one's error.
        let [near, far] = limits(truth.as_ref().map_or(&results[0].depth, |t| &t.depth), 1.0, 99.0);
        let errors: Vec<Vec<f32>> =
            results.iter().map(|r| truth.as_ref().map_or_else(Vec::new, |t| error(r, t))).collect();
        let p95 = errors.iter().map(|e| {
            percentile(&mut e.iter().filter(|v| v.is_finite()).map(|&v| f64::from(v.abs())).collect::<Vec<_>>(), 95.0)
        });
        let limit = p95.filter(|v| v.is_finite() && *v > 0.0).fold(f64::INFINITY, f64::min);
        let limit = if limit.is_finite() { 2.0 * limit } else { 1.0 };
        let _ = write!(html, "<h3>{}</h3><div class=grid>", escape(&numbers.row_label(row)));
        for ((cell, result), error) in mine.iter().zip(&results).zip(&errors) {
            let (w, h) = (result.camera.width, result.camera.height);
            let label = &experiment.methods[cell.method].label;
            let nearness: Vec<f32> = result.depth.iter().map(|&z| (near + far) as f32 - z).collect();
            let depth = Picture::of_map(&nearness, w, h, [near, far], DEPTH_COLORS).at_most(MAX_WIDTH);
            let _ = write!(html, "<figure><figcaption><b>{}</b></figcaption>{}", escape(label), img(&depth, label));
            if !error.is_empty() {
                let map = Picture::of_map(error, w, h, [-limit, limit], colorous::RED_BLUE).at_most(MAX_WIDTH);
                html += &img(&map, &format!("{label}, error"));
                html += &color_bar(colorous::RED_BLUE, [-limit, limit], "mm");
            }
            html += "</figure>";
        }
        html += "</div>";
    }
    Ok(html)
}

/// Returns the error of every pixel of the mask, mm; NaN elsewhere.
fn error(result: &SavedResult, truth: &GroundTruth) -> Vec<f32> {
    (0..truth.mask.len()).map(|i| if truth.mask[i] { result.depth[i] - truth.depth[i] } else { f32::NAN }).collect()
}
