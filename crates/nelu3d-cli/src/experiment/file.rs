//! An experiment as its file says it: which rigs, scenes, methods, seeds, and what is tabulated.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, anyhow, bail};
use nelu3d_scan::input::{read_text, shortened, toml_reason};
use nelu3d_sim::Spec;
use nelu3d_sim::spec::PRESETS;
use serde::Deserialize;
use toml::{Table, Value};

use super::claim::Claim;
use super::columns;

/// The experiments that come with the program: name and file.
pub(super) const BUILT_IN: [(&str, &str); 17] = [
    ("table1", include_str!("../../experiments/table1.toml")),
    ("table2", include_str!("../../experiments/table2.toml")),
    ("fig3", include_str!("../../experiments/fig3.toml")),
    ("fig6", include_str!("../../experiments/fig6.toml")),
    ("fig7", include_str!("../../experiments/fig7.toml")),
    ("number", include_str!("../../experiments/number.toml")),
    ("kind", include_str!("../../experiments/kind.toml")),
    ("blend", include_str!("../../experiments/blend.toml")),
    ("exposure", include_str!("../../experiments/exposure.toml")),
    ("positions", include_str!("../../experiments/positions.toml")),
    ("stage", include_str!("../../experiments/stage.toml")),
    ("motion", include_str!("../../experiments/motion.toml")),
    ("colors", include_str!("../../experiments/colors.toml")),
    ("mixed", include_str!("../../experiments/mixed.toml")),
    ("limits", include_str!("../../experiments/limits.toml")),
    ("sigma", include_str!("../../experiments/sigma.toml")),
    ("handheld", include_str!("../../experiments/handheld.toml")),
];

/// An experiment.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Experiment {
    /// Title of the experiment.
    pub title: String,
    /// Which table, figure or section of which publication it repeats.
    #[serde(default)]
    pub source: String,
    /// What to know before reading the numbers.
    #[serde(default)]
    pub note: String,
    /// Seeds: of the virtual rigs (noise, jitter) and, where a command says `{seed}`, of the method.
    #[serde(default = "first_seed")]
    pub seeds: Vec<u64>,
    /// The rigs by name.
    pub rigs: BTreeMap<String, RigSource>,
    /// What is scanned: the rows.
    pub cases: Vec<Case>,
    /// A quantity that takes several values in every case.
    #[serde(default)]
    pub vary: Option<Vary>,
    /// How it is scanned: the columns.
    pub methods: Vec<Method>,
    /// The label of the method that the others are compared with, as `against` in `columns`.
    #[serde(default)]
    pub against: Option<String>,
    /// What is tabulated.
    pub columns: Vec<Column>,
    /// What the numbers are claimed to show.
    #[serde(default)]
    pub claims: Vec<Claim>,
    /// Words that stand for `{name}` in rigs and commands, such as the length of trainings, which quick runs change.
    #[serde(default)]
    pub settings: Table,
    /// What `--quick` changes: merged over everything above.
    #[serde(default, rename = "quick")]
    _quick: Table,
}

fn first_seed() -> Vec<u64> {
    vec![0]
}

/// Where a rig comes from: exactly one of `preset`, `spec` and `folder`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RigSource {
    /// A preset of the virtual scanner.
    #[serde(default)]
    pub preset: Option<String>,
    /// A file that describes a virtual scanner.
    #[serde(default)]
    pub spec: Option<PathBuf>,
    /// A rig folder that exists; nothing is written there.
    #[serde(default)]
    pub folder: Option<PathBuf>,
    /// Size of the virtual camera's images, as a part of the spec's.
    #[serde(default = "one")]
    pub scale: f64,
    /// Merged over the virtual scanner's spec: tables key by key, everything else, and a table whose `kind` changes,
    /// replaced.
    #[serde(default)]
    pub set: Table,
}

fn one() -> f64 {
    1.0
}

/// A row: a scene under a pattern set.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Case {
    /// Its name in the table.
    pub label: String,
    /// Its rig.
    pub rig: String,
    /// Its scene, or its sequence for methods that run `sequence`.
    pub scene: String,
    /// Its pattern set; the rig's first if there is none.
    #[serde(default)]
    pub set: Option<String>,
    /// Settings that replace the experiment's.
    #[serde(default)]
    pub settings: Table,
}

/// A quantity with several values. `{name}` in rigs and commands stands for it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Vary {
    /// The placeholder's name.
    pub name: String,
    /// What it is, with its unit.
    pub label: String,
    /// Its values.
    pub values: Vec<Value>,
    /// Whether its axis is logarithmic.
    #[serde(default)]
    pub log: bool,
}

/// A column: a command that makes a result.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Method {
    /// Its name in the table.
    pub label: String,
    /// `reconstruct` or `decode` with their options, as they are typed.
    pub run: String,
    /// Options of `calibrate` for the field that it needs (`reconstruct`), or that tells it the swept volume
    /// (`decode`).
    #[serde(default)]
    pub calibrate: String,
    /// Options of `nelu3d projector`: the method (`decode`) gets the projector that is calibrated from the sweep
    /// instead of the true one, and no field.
    #[serde(default)]
    pub projector: Option<String>,
    /// The pattern set, where it is not the case's: methods may need their own.
    #[serde(default)]
    pub set: Option<String>,
    /// The cases it runs on; all of them if empty.
    #[serde(default)]
    pub cases: Vec<String>,
    /// How many of the seeds it runs with; all of them if absent.
    #[serde(default)]
    pub seeds: Option<usize>,
}

/// A number that is tabulated.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Column {
    /// Its heading, with its unit.
    pub label: String,
    /// Where it is: a path into `result` (result.json), `calibrate` (the answer of `calibrate --json`), `step` (what
    /// the command took), `cad` (the answer of `evaluate --cad`) or `against`.
    pub value: String,
    /// It is multiplied by this.
    #[serde(default = "one")]
    pub times: f64,
    /// Digits after the point.
    #[serde(default = "three")]
    pub digits: usize,
    /// Whether it gets a table of its own, cases against methods, and a plot.
    #[serde(default)]
    pub main: bool,
    /// Whether more is better.
    #[serde(default)]
    pub more_is_better: bool,
    /// Whether the plot's axis is logarithmic.
    #[serde(default)]
    pub log: bool,
}

fn three() -> usize {
    3
}

impl Experiment {
    /// Reads a built-in experiment by its name, or a file. `quick` merges what the file says for quick runs.
    pub(super) fn read(name: &str, quick: bool) -> Result<(String, Self)> {
        let whose = name;
        let (name, text, dir) = match BUILT_IN.iter().find(|(n, _)| *n == name) {
            Some((n, text)) => ((*n).to_owned(), (*text).to_owned(), PathBuf::new()),
            None => {
                let path = Path::new(name);
                let known = BUILT_IN.map(|(n, _)| n).join(", ");
                if !path.exists() {
                    bail!("`{name}` is neither an experiment ({known}) nor a file; name one of them");
                }
                let text = read_text(path).with_context(|| format!("{name}: cannot be read"))?;
                let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                (stem, text, path.parent().map(Path::to_path_buf).unwrap_or_default())
            }
        };
        let mut experiment = Self::parse(&text, quick).with_context(|| format!("experiment {whose}"))?;
        for rig in experiment.rigs.values_mut() {
            for file in [&mut rig.spec, &mut rig.folder].into_iter().flatten() {
                *file = dir.join(&*file);
            }
        }
        Ok((name, experiment))
    }

    /// Parses a file, with the changes of quick runs if asked for.
    fn parse(text: &str, quick: bool) -> Result<Self> {
        let mut table: Table =
            toml::from_str(text).map_err(|e| anyhow!("{}; correct the file", toml_reason(&e, text)))?;
        if quick && let Some(Value::Table(changes)) = table.get("quick").cloned() {
            merge(&mut table, &changes);
        }
        let experiment: Self =
            table.try_into().map_err(|e: toml::de::Error| anyhow!("{}; correct the file", shortened(e.message())))?;
        experiment.check()?;
        Ok(experiment)
    }

    /// Checks that everything that is named exists.
    fn check(&self) -> Result<()> {
        for (name, rig) in &self.rigs {
            let sources = [rig.preset.is_some(), rig.spec.is_some(), rig.folder.is_some()];
            if sources.iter().filter(|s| **s).count() != 1 {
                bail!("rig `{name}` must have one of `preset`, `spec` and `folder`");
            }
            if rig.folder.is_some() && (rig.scale != 1.0 || !rig.set.is_empty()) {
                bail!("rig `{name}` is a folder; `scale` and `set` are for virtual rigs");
            }
            if let Some(preset) = rig.preset.as_deref().filter(|p| Spec::preset(p).is_none()) {
                let known = PRESETS.map(|(name, _)| name).join(", ");
                bail!("rig `{name}`: there is no preset `{preset}`; name one of: {known}");
            }
            if !(rig.scale > 0.0 && rig.scale <= 8.0) {
                bail!("rig `{name}`: `scale` is {}; give a number above 0, up to 8", rig.scale);
            }
        }
        if self.seeds.is_empty() || self.cases.is_empty() || self.methods.is_empty() || self.columns.is_empty() {
            bail!("give it at least one of each: `seeds`, `cases`, `methods`, `columns`");
        }
        if self.vary.as_ref().is_some_and(|v| v.values.is_empty()) {
            bail!("`vary.values` is empty; give at least one value, or leave `vary` out");
        }
        for column in &self.columns {
            columns::check(&column.value).with_context(|| format!("column `{}`", column.label))?;
            if column.value.starts_with("against.") && self.against.is_none() {
                bail!("column `{}`: `{}` needs `against`, the label of a method", column.label, column.value);
            }
        }
        for case in &self.cases {
            if !self.rigs.contains_key(&case.rig) {
                bail!("case `{}`: there is no rig `{}`; name one of `rigs`", case.label, case.rig);
            }
        }
        for method in &self.methods {
            if !matches!(method.run.split_whitespace().next(), Some("reconstruct" | "decode" | "sequence")) {
                bail!("method `{}`: `run` must begin with `reconstruct`, `decode` or `sequence`", method.label);
            }
            if method.seeds == Some(0) {
                bail!("method `{}`: `seeds` is 0, so it would never run; give 1 or more", method.label);
            }
            if method.projector.is_some() && !method.run.starts_with("decode") {
                bail!("method `{}`: `projector` is for `decode`", method.label);
            }
            if let Some(case) = method.cases.iter().find(|c| self.cases.iter().all(|k| k.label != **c)) {
                bail!("method `{}`: there is no case `{case}`", method.label);
            }
        }
        let columns: Vec<&str> = self.columns.iter().map(|c| c.label.as_str()).collect();
        let methods: Vec<&str> = self.methods.iter().map(|m| m.label.as_str()).collect();
        let cases: Vec<&str> = self.cases.iter().map(|c| c.label.as_str()).collect();
        for claim in &self.claims {
            claim.check(&columns, &methods, &cases)?;
        }
        if let Some(label) = self.against.as_ref().filter(|l| self.methods.iter().all(|m| m.label != **l)) {
            bail!("`against`: there is no method `{label}`");
        }
        Ok(())
    }
}

/// Merges `changes` over `table`: tables key by key, everything else replaced. A table of another `kind` has other
/// keys: it is replaced as a whole.
pub(super) fn merge(table: &mut Table, changes: &Table) {
    for (key, change) in changes {
        match (table.get_mut(key), change) {
            (Some(Value::Table(old)), Value::Table(new)) if !changes_kind(old, new) => merge(old, new),
            _ => {
                table.insert(key.clone(), change.clone());
            }
        }
    }
}

fn changes_kind(old: &Table, new: &Table) -> bool {
    matches!((old.get("kind"), new.get("kind")), (Some(a), Some(b)) if a != b)
}

/// Replaces `"{name}"` by the value, keeping its type, and `{name}` within longer texts by its text.
pub(super) fn substitute(value: &mut Value, name: &str, by: &Value) {
    match value {
        Value::String(s) if *s == format!("{{{name}}}") => *value = by.clone(),
        Value::String(s) => *s = substitute_text(s, name, by),
        Value::Array(list) => list.iter_mut().for_each(|v| substitute(v, name, by)),
        Value::Table(table) => table.iter_mut().for_each(|(_, v)| substitute(v, name, by)),
        _ => {}
    }
}

/// Replaces `{name}` within a text.
pub(super) fn substitute_text(text: &str, name: &str, by: &Value) -> String {
    text.replace(&format!("{{{name}}}"), &plain(by))
}

/// Returns a value without quotes.
pub(super) fn plain(value: &Value) -> String {
    match value {
        Value::String(s) => s.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_experiments_are_sound_quick_or_not() {
        for (name, _) in BUILT_IN {
            for quick in [false, true] {
                Experiment::read(name, quick).unwrap_or_else(|e| panic!("{name}: {e:#}"));
            }
        }
    }

    #[test]
    fn changes_are_merged_and_placeholders_keep_types() {
        let mut a: Table = toml::from_str("x = 1\n[t]\ny = 2\nz = [1, 2]").unwrap();
        merge(&mut a, &toml::from_str("[t]\nz = [\"{n}\"]\nw = \"a {n}\"").unwrap());
        let mut value = Value::Table(a);
        substitute(&mut value, "n", &Value::Float(0.5));
        let expected: Table = toml::from_str("x = 1\n[t]\ny = 2\nz = [0.5]\nw = \"a 0.5\"").unwrap();
        assert_eq!(value, Value::Table(expected));
        let mut spec: Table = toml::from_str("[sweep]\nkind = 'stage'\nslope = 1\nn = 3").unwrap();
        merge(&mut spec, &toml::from_str("[sweep]\nkind = 'handheld'\nn = 4").unwrap());
        let expected: Table = toml::from_str("[sweep]\nkind = 'handheld'\nn = 4").unwrap();
        assert_eq!(spec, expected, "keys of another kind are gone");
    }

    #[test]
    fn what_makes_no_sense_is_said() {
        let good = "title = 't'\n[rigs.r]\npreset = 'demo'\n[[cases]]\nlabel = 'c'\nrig = 'r'\nscene = 's'\n[[methods]]\nlabel \
                    = 'm'\nrun = 'reconstruct'\n[[columns]]\nlabel = 'l'\nvalue = 'step.wall_secs'\n";
        Experiment::parse(good, false).unwrap();
        for (from, to, say) in [
            ("rig = 'r'", "rig = 'q'", "there is no rig `q`"),
            ("preset = 'demo'", "scale = 2", "one of `preset`"),
            ("run = 'reconstruct'", "run = 'rm -r'", "must begin with"),
            ("label = 'c'", "label = 'c'\nlabbel = 3", "labbel"),
            ("preset = 'demo'", "preset = 'dmo'", "there is no preset `dmo`; name one of: demo"),
            ("run = 'reconstruct'", "run = 'reconstruct'\nseeds = 0", "would never run; give 1 or more"),
            ("step.wall_secs", "step.wall_sec", "column `l`: `step.wall_sec` is no value: `step` has no `wall_sec`"),
            ("step.wall_secs", "against.depth_mm.mae", "needs `against`"),
            ("title = 't'", "title = 't'\nvary = { name = 'x', label = 'x', values = [] }", "`vary.values` is empty"),
            ("[[columns]]", "[[claims]]\ncolumn = 'k'\nmethod = 'm'\nat_most = 1\n[[columns]]", "column `k`"),
            ("[[columns]]", "[[claims]]\ncolumn = 'l'\nmethod = 'n'\nat_most = 1\n[[columns]]", "no method `n`"),
            ("[[columns]]", "[[claims]]\ncolumn = 'l'\nmethod = 'm'\n[[columns]]", "one of `at_most`"),
        ] {
            let error = Experiment::parse(&good.replace(from, to), false).unwrap_err();
            assert!(format!("{error:#}").contains(say), "{error:#}");
        }
    }
}
