//! What a finished sequence is besides its frames: one table, one moving surface, one preview.

use std::fmt;
use std::path::Path;

use anyhow::{Context as _, Result};
use nelu3d_scan::output::{create_dir, write_atomic};
use nelu3d_scan::rig::Shot;
use serde_json::{Value, json};

use super::super::shown;
use super::folder::Folder;

/// The moving surface.
pub(super) const ANIMATION: &str = "animation.glb";
/// The moving picture.
pub(super) const PREVIEW: &str = "preview.png";
/// Folder of all surfaces, numbered.
pub(super) const MESHES: &str = "meshes";
/// Everything in numbers.
const TABLE: &str = "sequence.json";

/// One line per frame.
pub(super) struct Table(Vec<Row>);

struct Row {
    frame: String,
    /// `None` if it failed.
    summary: Option<Value>,
    failure: Option<String>,
}

/// Writes everything that spans frames; all of them are done or have failed.
pub(super) fn write(folder: &Folder, frames: &[Shot], fps: f64) -> Result<Table> {
    let mut rows = Vec::with_capacity(frames.len());
    for frame in frames {
        let summary = folder.is_done(frame).then(|| folder.summary(frame)).transpose()?;
        rows.push(Row { frame: frame.name.clone(), summary, failure: folder.failure(frame) });
    }
    let table = Table(rows);
    let done: Vec<&Shot> = frames.iter().filter(|f| folder.is_done(f)).collect();
    meshes(folder, &done)?;
    let json = json!({ "fps": fps, "mean": table.mean(), "frames": table.json() });
    write_atomic(&folder.root().join(TABLE), |w| Ok(serde_json::to_writer_pretty(w, &json)?))?;
    Ok(table)
}

/// The frames' meshes in one folder, as programs that open numbered files want them. They are links to the files in the frames' folders
/// where the disk has such.
fn meshes(folder: &Folder, frames: &[&Shot]) -> Result<()> {
    let dir = folder.root().join(MESHES);
    create_dir(&dir)?;
    for (i, frame) in frames.iter().enumerate() {
        let (from, to) = (folder.frame(frame).join("mesh.ply"), dir.join(format!("{i:04}.ply")));
        link(&from, &to).with_context(|| format!("{}: cannot be written", shown(&to)))?;
    }
    Ok(())
}

fn link(from: &Path, to: &Path) -> std::io::Result<()> {
    // Beside and renamed: another task may be doing the same.
    let beside = to.with_extension(format!("ply.{}", std::process::id()));
    let _ = std::fs::remove_file(&beside);
    std::fs::hard_link(from, &beside).or_else(|_| std::fs::copy(from, &beside).map(|_| ()))?;
    std::fs::rename(&beside, to)
}

impl Row {
    fn number(&self, path: &str) -> Option<f64> {
        self.summary.as_ref()?.pointer(path)?.as_f64()
    }

    fn json(&self) -> Value {
        json!({
            "frame": self.frame,
            "failed": self.failure,
            "kept": self.number("/pixels/kept"),
            "start": self.summary.as_ref().and_then(|s| s.pointer("/method/start")),
            "motion": self.summary.as_ref().and_then(|s| s.pointer("/method/motion")),
            "cpu_secs": self.number("/cpu_secs"),
            "wall_secs": self.number("/wall_secs"),
            "metrics": self.summary.as_ref().and_then(|s| s.get("metrics")),
        })
    }
}

impl Table {
    /// Means over the frames of every number in their rows.
    pub(super) fn mean(&self) -> Value {
        let rows: Vec<Value> = self.0.iter().filter(|r| r.summary.is_some()).map(Row::json).collect();
        mean(&rows.iter().collect::<Vec<_>>())
    }

    /// One object per frame.
    pub(super) fn json(&self) -> Value {
        self.0.iter().map(Row::json).collect()
    }
}

/// Means of numbers, key by key; of what is no number in some row, nothing.
fn mean(rows: &[&Value]) -> Value {
    if let Some(Value::Object(first)) = rows.first() {
        let of = |key: &String| -> Value {
            let values: Vec<&Value> = rows.iter().filter_map(|r| r.get(key)).collect();
            if values.len() == rows.len() { mean(&values) } else { Value::Null }
        };
        return first.keys().map(|key| (key.clone(), of(key))).filter(|(_, v)| !v.is_null()).collect();
    }
    let numbers: Vec<f64> = rows.iter().filter_map(|v| v.as_f64()).collect();
    if numbers.is_empty() || numbers.len() < rows.len() {
        return Value::Null;
    }
    json!(numbers.iter().sum::<f64>() / numbers.len() as f64)
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let judged = self.0.iter().any(|r| r.number("/metrics/whole/depth_mm/mae").is_some());
        write!(f, "frame         pixels  start  px/frame   time   CPU s")?;
        writeln!(f, "{}", if judged { "  coverage  MAE mm  median  body MAE  median" } else { "" })?;
        for row in &self.0 {
            if let (None, Some(why)) = (&row.summary, &row.failure) {
                writeln!(f, "{:<12}  failed: {why}", row.frame)?;
                continue;
            }
            let warm = row.number("/method/start/found_anew").is_some();
            let show = |path: &str, digits: usize| row.number(path).map_or("–".into(), |v| format!("{v:.digits$}"));
            write!(
                f,
                "{:<12}  {:>6}  {:<5}  {:>8}  {:>5}  {:>6}",
                row.frame,
                show("/pixels/kept", 0),
                if warm { "warm" } else { "cold" },
                show("/method/motion/speed_px", 2),
                show("/method/motion/pattern_time/frames", 2),
                show("/cpu_secs", 2),
            )?;
            if judged {
                let coverage =
                    row.number("/metrics/whole/coverage").map_or("–".into(), |v| format!("{:.1} %", 100.0 * v));
                write!(
                    f,
                    "  {coverage:>8}  {:>6}  {:>6}  {:>8}  {:>6}",
                    show("/metrics/whole/depth_mm/mae", 3),
                    show("/metrics/whole/depth_mm/median", 3),
                    show("/metrics/body/depth_mm/mae", 3),
                    show("/metrics/body/depth_mm/median", 3),
                )?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
