//! The values that stand for placeholders in one cell.

use toml::Table;

use super::file::{Case, Experiment, substitute, substitute_text};

/// The values that stand for placeholders in one cell.
pub(super) struct Placeholders<'a> {
    /// The experiment.
    pub(super) experiment: &'a Experiment,
    /// The case, whose settings replace the experiment's.
    pub(super) case: &'a Case,
    /// Index of the varied value.
    pub(super) value: usize,
    /// The seed.
    pub(super) seed: u64,
}

impl Placeholders<'_> {
    /// Returns names and values.
    fn values(&self) -> Vec<(&str, toml::Value)> {
        let mut values = vec![("seed", toml::Value::Integer(self.seed as i64))];
        for settings in [&self.case.settings, &self.experiment.settings] {
            values.extend(settings.iter().map(|(name, value)| (name.as_str(), value.clone())));
        }
        values.extend(self.experiment.vary.iter().map(|v| (v.name.as_str(), v.values[self.value].clone())));
        values
    }

    /// Fills in the placeholders of a table.
    pub(super) fn table(&self, table: &Table) -> Table {
        let mut all = toml::Value::Table(table.clone());
        for (name, value) in self.values() {
            substitute(&mut all, name, &value);
        }
        match all {
            toml::Value::Table(table) => table,
            _ => unreachable!("it was a table"),
        }
    }

    /// Fills in the placeholders of a command and splits it into words.
    pub(super) fn words(&self, text: &str) -> Vec<String> {
        let mut text = text.to_owned();
        for (name, value) in self.values() {
            text = substitute_text(&text, name, &value);
        }
        text.split_whitespace().map(str::to_owned).collect()
    }
}
