//! Numbers of an experiment: means and spreads over seeds, as Markdown, CSV and JSON.

use std::fmt::Write;

use serde_json::{Value, json};

use super::cell::ExperimentCell;
use super::file::{Column, Experiment, plain};

/// The numbers of one method on one row, over the seeds.
#[derive(Clone, Debug)]
pub(super) struct TableEntry {
    /// Index of the row: case × value.
    pub row: usize,
    /// Index of the method.
    pub method: usize,
    /// One number per column.
    pub numbers: Vec<Option<MeanOverSeeds>>,
    /// Why there are none, where there are none.
    pub problem: Option<String>,
}

/// A mean over seeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MeanOverSeeds {
    /// The mean.
    pub mean: f64,
    /// Standard deviation over the seeds; `None` for one.
    pub spread: Option<f64>,
    /// Number of seeds.
    pub n: usize,
}

/// All numbers of an experiment.
pub(super) struct ExperimentNumbers<'a> {
    pub experiment: &'a Experiment,
    pub entries: Vec<TableEntry>,
}

impl<'a> ExperimentNumbers<'a> {
    pub(super) fn of(experiment: &'a Experiment, cells: &[ExperimentCell]) -> Self {
        let n_values = n_values(experiment);
        let mut entries = Vec::new();
        for row in 0..experiment.cases.len() * n_values {
            for method in 0..experiment.methods.len() {
                let mine: Vec<&ExperimentCell> =
                    cells.iter().filter(|c| c.case * n_values + c.value == row && c.method == method).collect();
                if mine.is_empty() {
                    continue;
                }
                let number = |column: &Column| {
                    let values: Vec<f64> = mine
                        .iter()
                        .filter_map(|c| c.document.as_ref().ok())
                        .filter_map(|d| find(d, &column.value))
                        .map(|v| v * column.times)
                        .collect();
                    MeanOverSeeds::of(&values)
                };
                let failed: Vec<&String> = mine.iter().filter_map(|c| c.document.as_ref().err()).collect();
                let problem = failed.first().map(|e| match failed.len() == mine.len() {
                    true => (*e).clone(),
                    false => format!("{} of {} seeds failed: {e}", failed.len(), mine.len()),
                });
                entries.push(TableEntry {
                    row,
                    method,
                    numbers: experiment.columns.iter().map(number).collect(),
                    problem,
                });
            }
        }
        Self { experiment, entries }
    }

    /// Returns the name of the case of a row.
    pub(super) fn case_label(&self, row: usize) -> &'a String {
        &self.experiment.cases[row / n_values(self.experiment)].label
    }

    /// Returns the name of a row.
    pub(super) fn row_label(&self, row: usize) -> String {
        let n_values = n_values(self.experiment);
        let case = self.case_label(row);
        match &self.experiment.vary {
            None => case.clone(),
            Some(v) => format!("{case}, {}", plain(&v.values[row % n_values])),
        }
    }

    pub(super) fn n_rows(&self) -> usize {
        self.experiment.cases.len() * n_values(self.experiment)
    }

    pub(super) fn entry(&self, row: usize, method: usize) -> Option<&TableEntry> {
        self.entries.iter().find(|e| e.row == row && e.method == method)
    }

    /// Returns the table of a main column: headings, then rows against methods. The best of a row is marked if there
    /// are two.
    pub(super) fn pivot(&self, column: usize) -> (Vec<String>, Vec<Vec<TableCell>>) {
        let experiment = self.experiment;
        let c = &experiment.columns[column];
        let mut headings = vec![experiment.vary.as_ref().map_or_else(String::new, |v| v.label.clone())];
        headings.extend(experiment.methods.iter().map(|m| m.label.clone()));
        let rows = (0..self.n_rows()).map(|row| {
            let numbers: Vec<Option<MeanOverSeeds>> =
                (0..experiment.methods.len()).map(|m| self.entry(row, m).and_then(|e| e.numbers[column])).collect();
            let better = |a: f64, b: f64| if c.more_is_better { a > b } else { a < b };
            let best = numbers.iter().flatten().map(|n| n.mean).reduce(|a, b| if better(b, a) { b } else { a });
            let contested = numbers.iter().flatten().count() > 1;
            let mut cells = vec![TableCell { text: self.row_label(row), best: false }];
            cells.extend(numbers.iter().map(|n| TableCell {
                text: n.map_or_else(|| "–".to_owned(), |n| n.text(c.digits)),
                best: contested && n.is_some_and(|n| Some(n.mean) == best),
            }));
            cells
        });
        (headings, rows.collect())
    }

    /// Returns every number: headings, then a row per row and method.
    pub(super) fn long(&self) -> (Vec<String>, Vec<Vec<String>>) {
        let mut headings = vec!["case".to_owned(), "method".to_owned()];
        headings.extend(self.experiment.columns.iter().map(|c| c.label.clone()));
        let rows = self.entries.iter().map(|e| {
            let mut cells = vec![self.row_label(e.row), self.experiment.methods[e.method].label.clone()];
            cells.extend(e.numbers.iter().zip(&self.experiment.columns).map(|(n, c)| match n {
                Some(n) => n.text(c.digits),
                None => "–".to_owned(),
            }));
            cells
        });
        (headings, rows.collect())
    }

    /// Returns why methods have no numbers on some rows: a line per reason.
    pub(super) fn problems(&self) -> Vec<String> {
        let mut reasons: Vec<(&str, Vec<String>)> = Vec::new();
        for e in &self.entries {
            let Some(problem) = &e.problem else { continue };
            let place = format!("{}, {}", self.row_label(e.row), self.experiment.methods[e.method].label);
            match reasons.iter_mut().find(|r| r.0 == problem) {
                Some(reason) => reason.1.push(place),
                None => reasons.push((problem, vec![place])),
            }
        }
        reasons.iter().map(|(reason, places)| format!("{}: {reason}", places.join("; "))).collect()
    }

    /// Returns Markdown: a table per main column, what is claimed, then all numbers, then what is missing.
    pub(super) fn markdown(&self, claims: &[String], name: &str, made: &str) -> String {
        let experiment = self.experiment;
        let mut text = format!("## {}\n\n", experiment.title);
        if !experiment.source.is_empty() {
            let _ = writeln!(text, "{}.\n", experiment.source.trim_end_matches('.'));
        }
        if !experiment.note.is_empty() {
            let _ = writeln!(text, "{}\n", experiment.note.trim());
        }
        let _ = writeln!(text, "`nelu3d experiment {name}`, {made}\n");
        for (i, column) in experiment.columns.iter().enumerate().filter(|(_, c)| c.main) {
            let _ = writeln!(text, "**{}**\n", column.label);
            let (headings, rows) = self.pivot(i);
            let rows: Vec<Vec<String>> = rows
                .into_iter()
                .map(|r| r.into_iter().map(|c| if c.best { format!("**{}**", c.text) } else { c.text }).collect())
                .collect();
            text += &markdown_table(&headings, &rows);
        }
        if !claims.is_empty() {
            text += "Claims:\n\n";
            for claim in claims {
                let _ = writeln!(text, "- {claim}");
            }
            text.push('\n');
        }
        let (headings, rows) = self.long();
        text += "<details><summary>All numbers</summary>\n\n";
        text += &markdown_table(&headings, &rows);
        text += "</details>\n";
        let problems = self.problems();
        if !problems.is_empty() {
            text += "\nWithout a result:\n\n";
            for p in problems {
                let _ = writeln!(text, "- {p}");
            }
        }
        text
    }

    /// Returns comma-separated values: a line per row and method, each column's mean and spread.
    pub(super) fn csv(&self) -> String {
        let quoted = |s: &str| format!("\"{}\"", s.replace('"', "\"\""));
        let mut text = "case,method,seeds".to_owned();
        for c in &self.experiment.columns {
            let _ = write!(text, ",{},{}", quoted(&c.label), quoted(&format!("{} spread", c.label)));
        }
        text.push('\n');
        for e in &self.entries {
            let seeds = e.numbers.iter().flatten().map(|n| n.n).max().unwrap_or(0);
            let method = &self.experiment.methods[e.method].label;
            let _ = write!(text, "{},{},{seeds}", quoted(&self.row_label(e.row)), quoted(method));
            for n in &e.numbers {
                let mean = n.map(|n| n.mean.to_string()).unwrap_or_default();
                let spread = n.and_then(|n| n.spread).map(|s| s.to_string()).unwrap_or_default();
                let _ = write!(text, ",{mean},{spread}");
            }
            text.push('\n');
        }
        text
    }

    /// Returns all numbers for programs.
    pub(super) fn json(&self, claims: &[Value]) -> Value {
        let entries = self.entries.iter().map(|e| {
            let numbers = e.numbers.iter().zip(&self.experiment.columns).map(|(n, c)| {
                json!({
                    "column": c.label,
                    "mean": n.map(|n| n.mean),
                    "spread": n.and_then(|n| n.spread),
                    "seeds": n.map_or(0, |n| n.n),
                })
            });
            json!({
                "case": self.row_label(e.row),
                "method": self.experiment.methods[e.method].label,
                "numbers": numbers.collect::<Vec<_>>(),
                "problem": e.problem,
            })
        });
        json!({ "title": self.experiment.title, "entries": entries.collect::<Vec<_>>(), "claims": claims })
    }
}

/// A cell that may be the best of its row.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TableCell {
    pub text: String,
    pub best: bool,
}

impl MeanOverSeeds {
    fn of(values: &[f64]) -> Option<Self> {
        let n = values.len();
        let mean = values.iter().sum::<f64>() / n as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n as f64 - 1.0);
        (n > 0).then(|| Self { mean, spread: (n > 1).then(|| variance.sqrt()), n })
    }

    fn text(&self, digits: usize) -> String {
        match self.spread {
            Some(spread) => format!("{:.digits$} ± {spread:.digits$}", self.mean),
            None => format!("{:.digits$}", self.mean),
        }
    }
}

/// Returns the number of values of the varied quantity.
fn n_values(experiment: &Experiment) -> usize {
    experiment.vary.as_ref().map_or(1, |v| v.values.len())
}

/// Returns the number at a path of keys separated by dots.
fn find(document: &Value, path: &str) -> Option<f64> {
    path.split('.').try_fold(document, |at, key| at.get(key))?.as_f64()
}

/// Returns a table in Markdown.
fn markdown_table(headings: &[String], rows: &[Vec<String>]) -> String {
    let mut text = format!("| {} |\n|{}\n", headings.join(" | "), "---|".repeat(headings.len()));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text.push('\n');
    text
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    fn experiment() -> Experiment {
        toml::from_str(
            "title = 't'\nseeds = [0, 1]\n[rigs.r]\npreset = 'demo'\n[[cases]]\nlabel = 'a'\nrig = 'r'\nscene = 's'\n\
             [[cases]]\nlabel = 'b'\nrig = 'r'\nscene = 's'\n[[methods]]\nlabel = 'm'\nrun = 'reconstruct'\n[[methods]]\n\
             label = 'n'\nrun = 'decode'\n[[columns]]\nlabel = 'error'\nvalue = 'result.x.mae'\nmain = true\ndigits = 1",
        )
        .unwrap()
    }

    fn cell(case: usize, seed: u64, method: usize, document: Result<f64, &str>) -> ExperimentCell {
        ExperimentCell {
            case,
            value: 0,
            seed,
            method,
            folder: PathBuf::new(),
            scene: PathBuf::new(),
            commands: Vec::new(),
            document: document.map(|v| json!({ "result": { "x": { "mae": v } } })).map_err(str::to_owned),
        }
    }

    #[test]
    fn means_spreads_the_best_and_what_failed() {
        let experiment = experiment();
        let cells = [
            cell(0, 0, 0, Ok(1.0)),
            cell(0, 1, 0, Ok(3.0)),
            cell(0, 0, 1, Ok(1.5)),
            cell(0, 1, 1, Ok(1.5)),
            cell(1, 0, 0, Ok(4.0)),
            cell(1, 1, 0, Err("no board")),
            cell(1, 0, 1, Err("no board")),
            cell(1, 1, 1, Err("no board")),
        ];
        let numbers = ExperimentNumbers::of(&experiment, &cells);
        let (headings, rows) = numbers.pivot(0);
        assert_eq!(headings, ["", "m", "n"]);
        let texts: Vec<Vec<(&str, bool)>> =
            rows.iter().map(|r| r.iter().map(|c| (c.text.as_str(), c.best)).collect()).collect();
        assert_eq!(texts[0], [("a", false), ("2.0 ± 1.4", false), ("1.5 ± 0.0", true)]);
        assert_eq!(texts[1], [("b", false), ("4.0", false), ("–", false)]);
        assert_eq!(numbers.problems(), ["b, m: 1 of 2 seeds failed: no board", "b, n: no board"]);
        assert!(numbers.csv().contains("\"a\",\"m\",2,2,1.414"));
        assert!(numbers.markdown(&[], "t", "today").contains("| a | 2.0 ± 1.4 | **1.5 ± 0.0** |"));
        assert_eq!(numbers.json(&[])["entries"][1]["numbers"][0]["mean"], 1.5);
    }
}
