//! Tables of a result.

use std::fmt::Write;

use nelu3d::PixelStatus;
use nelu3d::result::{Input, Summary};
use nelu3d_evaluate::Metrics;
use serde_json::Value;

use crate::chart::curve;
use crate::html::{escape, table};
use crate::number::{grouped, percent};
use crate::page;

/// Shows the errors by region.
pub(super) fn metrics_table(metrics: &Metrics) -> String {
    let legend = "<p class=note>whole: everything the light source and the camera both see. body: without 3 px next to \
                  silhouettes, shadow borders and depth jumps. grazing: seen at more than 70°. Errors are over the \
                  pixels that have a depth; bias is result − ground truth.</p>";
    page::section("Error against ground truth", &(table(&metrics.headings(), &metrics.rows()) + legend))
}

/// Shows how many pixels have which status.
pub(super) fn status_table(s: &Summary) -> String {
    let count = |l: PixelStatus| match l {
        PixelStatus::Valid => s.pixels.valid as u64,
        _ => s.pixels.rejected[l.key()].as_u64().unwrap_or(0),
    };
    let rows: Vec<Vec<String>> = PixelStatus::ALL
        .iter()
        .map(|&l| {
            let n = count(l);
            vec![l.label().to_owned(), grouped(n as usize), percent(n as f64 / s.pixels.total as f64)]
        })
        .collect();
    table(&["pixels", "number", "fraction"], &rows)
}

/// Shows the time of each stage.
pub(super) fn stages_table(s: &Summary) -> String {
    let row = |name: &str, wall: f64, cpu: f64| vec![name.to_owned(), format!("{wall:.2}"), format!("{cpu:.2}")];
    let mut rows: Vec<Vec<String>> = s.stages.iter().map(|t| row(&t.name, t.wall_secs, t.cpu_secs)).collect();
    rows.push(row("total", s.wall_secs, s.cpu_secs));
    table(&["stage", "s", "CPU s"], &rows)
}

/// Shows the files that were read.
pub(super) fn inputs_table(s: &Summary) -> String {
    let row = |i: &Input| vec![i.path.display().to_string(), grouped(i.bytes as usize), i.sha256.clone()];
    table(&["file", "bytes", "SHA-256"], &s.inputs.iter().map(row).collect::<Vec<_>>())
}

/// Shows whatever the method put on record, one line a value; long lists of numbers as curves.
pub(super) fn value_table(values: &Value) -> String {
    fn lines(path: &str, value: &Value, out: &mut String) {
        let mut line = |cell: &str| {
            let _ = write!(out, "<tr><td>{}</td><td>{cell}</td></tr>", escape(path));
        };
        match value {
            Value::Object(map) => {
                for (key, v) in map {
                    let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                    lines(&path, v, out);
                }
            }
            Value::Array(list) if list.len() > 8 && list.iter().all(Value::is_number) => {
                line(&curve(&list.iter().filter_map(Value::as_f64).collect::<Vec<_>>()));
            }
            Value::String(s) => line(&escape(s)),
            other => line(&escape(&other.to_string())),
        }
    }
    let mut out = String::new();
    lines("", values, &mut out);
    format!("<div class=scroll><table class=values>{out}</table></div>")
}
