//! The table of a sequence: one row per frame.

use std::collections::BTreeMap;
use std::fmt;

use anyhow::Result;
use nelu3d_scan::rig::Shot;
use serde_json::{Value, json};

use super::folder::SequenceFolder;

/// The table of a sequence: one row per frame.
pub(super) struct SequenceTable(Vec<FrameRow>);

/// A frame's row.
struct FrameRow {
    /// Name of the frame.
    frame: String,
    /// Content of its result.json; `None` if it failed.
    summary: Option<Value>,
    /// Why it failed, if it did.
    failure: Option<String>,
}

impl FrameRow {
    /// Returns a number of result.json.
    fn number(&self, path: &str) -> Option<f64> {
        self.summary.as_ref()?.pointer(path)?.as_f64()
    }

    /// Returns the codes of the frame's findings: of its "warnings" or its "notes".
    fn codes(&self, findings: &str) -> Vec<&str> {
        let all = self.summary.as_ref().and_then(|s| s.get(findings)).and_then(Value::as_array);
        all.into_iter().flatten().filter_map(|f| f.get("code").and_then(Value::as_str)).collect()
    }

    /// Returns the row as an object.
    fn json(&self) -> Value {
        json!({
            "frame": self.frame,
            "failed": self.failure,
            "verdict": self.summary.as_ref().and_then(|s| s.get("verdict")),
            "warnings": self.codes("warnings"),
            "notes": self.codes("notes"),
            "drift": self.summary.as_ref().and_then(|s| s.pointer("/method/drift")),
            "kept": self.number("/pixels/kept"),
            "start": self.summary.as_ref().and_then(|s| s.pointer("/method/start")),
            "motion": self.summary.as_ref().and_then(|s| s.pointer("/method/motion")),
            "cpu_secs": self.number("/cpu_secs"),
            "wall_secs": self.number("/wall_secs"),
            "metrics": self.summary.as_ref().and_then(|s| s.get("metrics")),
        })
    }
}

impl SequenceTable {
    /// Reads the results of the frames, all of which are done or have failed.
    pub(super) fn read(folder: &SequenceFolder, frames: &[Shot]) -> Result<Self> {
        let mut rows = Vec::with_capacity(frames.len());
        for frame in frames {
            let summary = folder.is_done(frame).then(|| folder.summary(frame)).transpose()?;
            rows.push(FrameRow { frame: frame.name.clone(), summary, failure: folder.failure(frame) });
        }
        Ok(Self(rows))
    }

    /// Returns the means over the frames of every number in their rows.
    pub(super) fn mean(&self) -> Value {
        let rows: Vec<Value> = self.0.iter().filter(|r| r.summary.is_some()).map(FrameRow::json).collect();
        mean(&rows.iter().collect::<Vec<_>>())
    }

    /// Returns in how many frames each code is among the findings, "warnings" or "notes".
    pub(super) fn codes(&self, findings: &str) -> BTreeMap<&str, usize> {
        let mut codes = BTreeMap::new();
        self.0.iter().flat_map(|row| row.codes(findings)).for_each(|code| *codes.entry(code).or_insert(0) += 1);
        codes
    }

    /// Returns the verdict on the frames together: that of the worst.
    pub(super) fn verdict(&self) -> &'static str {
        let has = |verdict: &str| {
            self.0.iter().any(|r| r.summary.as_ref().is_some_and(|s| s.get("verdict").is_some_and(|v| v == verdict)))
        };
        ["bad", "doubtful"].into_iter().find(|v| has(v)).unwrap_or("good")
    }

    /// Returns a number of every frame's result.json.
    pub(super) fn numbers<'a>(&'a self, path: &'a str) -> impl Iterator<Item = f64> + 'a {
        self.0.iter().filter_map(move |row| row.number(path))
    }

    /// Returns one object per frame.
    pub(super) fn json(&self) -> Value {
        self.0.iter().map(FrameRow::json).collect()
    }
}

/// Averages numbers key by key; what is no number in some row is dropped.
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

impl fmt::Display for SequenceTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let evaluated = self.0.iter().any(|r| r.number("/metrics/whole/depth_mm/mae").is_some());
        write!(f, "frame         pixels  start  px/frame   time   CPU s")?;
        writeln!(f, "{}", if evaluated { "  coverage  MAE mm  median  body MAE  median" } else { "" })?;
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
            if evaluated {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_of_numbers_that_all_rows_have() {
        let rows =
            [json!({"a": 1.0, "b": {"c": 2}, "d": "x", "e": 5}), json!({"a": 3.0, "b": {"c": 4}, "d": "y", "e": null})];
        assert_eq!(mean(&rows.iter().collect::<Vec<_>>()), json!({"a": 2.0, "b": {"c": 3.0}}));
    }
}
