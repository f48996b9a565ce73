//! What an experiment claims: orderings of methods and bounds on numbers, checked whenever it runs.

use anyhow::{Result, bail};
use serde::Deserialize;
use serde_json::{Value, json};

use super::file::Experiment;
use super::table::ExperimentNumbers;

/// That a number of a method is at most, or at least, so much, or so many times another method's.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Claim {
    /// Heading of the column.
    pub column: String,
    /// Label of the method.
    pub method: String,
    /// The largest value that its mean over the seeds may have.
    #[serde(default)]
    pub at_most: Option<Bound>,
    /// The smallest value.
    #[serde(default)]
    pub at_least: Option<Bound>,
    /// The bound is multiplied by this.
    #[serde(default = "one")]
    pub times: f64,
    /// Labels of the cases for which it is claimed; all of them if empty.
    #[serde(default)]
    pub cases: Vec<String>,
}

/// What a number is compared with.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum Bound {
    /// A number, in the unit of the column.
    Number(f64),
    /// The number of the method with this label, on the same row.
    Method(String),
}

/// A claim, and the rows that contradict it.
pub(super) struct JudgedClaim {
    /// The claim as a sentence.
    pub text: String,
    /// What contradicts it: empty if it holds.
    pub against: Vec<String>,
}

fn one() -> f64 {
    1.0
}

impl Claim {
    /// Fails if it names what the experiment does not have, or bounds nothing.
    pub(super) fn check(&self, experiment: &Experiment) -> Result<()> {
        let column = &self.column;
        if experiment.columns.iter().all(|c| c.label != *column) {
            bail!("a claim is about column `{column}`, which is not there");
        }
        let (_, bound) = self.bound()?;
        let compared = if let Bound::Method(label) = bound { Some(label) } else { None };
        for label in [Some(&self.method), compared].into_iter().flatten() {
            if experiment.methods.iter().all(|m| m.label != *label) {
                bail!("the claim about `{column}`: there is no method `{label}`");
            }
        }
        if let Some(case) = self.cases.iter().find(|c| experiment.cases.iter().all(|k| k.label != **c)) {
            bail!("the claim about `{column}`: there is no case `{case}`");
        }
        Ok(())
    }

    /// Returns whether the bound is an upper one, and the bound.
    fn bound(&self) -> Result<(bool, &Bound)> {
        match (&self.at_most, &self.at_least) {
            (Some(bound), None) => Ok((true, bound)),
            (None, Some(bound)) => Ok((false, bound)),
            _ => bail!("the claim about `{}` needs one of `at_most` and `at_least`", self.column),
        }
    }

    /// Compares it with the numbers. A row on which one of the two methods does not run is no part of it; one on which
    /// it ran and has no number contradicts it, and so does a claim that no row is part of.
    pub(super) fn judge(&self, numbers: &ExperimentNumbers<'_>) -> Result<JudgedClaim> {
        let experiment = numbers.experiment;
        let (upper, bound) = self.bound()?;
        let (is, isnt) = if upper { ("at most", "more than") } else { ("at least", "less than") };
        let column = experiment.columns.iter().position(|c| c.label == self.column).unwrap_or_default();
        let digits = experiment.columns[column].digits;
        let method = |label: &str| experiment.methods.iter().position(|m| m.label == label).unwrap_or_default();
        let times = if self.times == 1.0 { String::new() } else { format!("{} × ", self.times) };
        let what = match bound {
            Bound::Number(limit) => format!("{}", limit * self.times),
            Bound::Method(other) => format!("{times}that of {other}"),
        };
        let cases = if self.cases.is_empty() { String::new() } else { format!(" on {}", self.cases.join("; ")) };
        let text = format!("{}: {} has {is} {what}{cases}", self.column, self.method);

        let (mut against, mut rows) = (Vec::new(), 0);
        for row in 0..numbers.n_rows() {
            if !self.cases.is_empty() && !self.cases.contains(numbers.case_label(row)) {
                continue;
            }
            let Some(mine) = numbers.entry(row, method(&self.method)) else { continue };
            let limit = match bound {
                Bound::Number(limit) => Some(*limit),
                Bound::Method(other) => match numbers.entry(row, method(other)) {
                    Some(entry) => entry.numbers[column].map(|n| n.mean),
                    None => continue,
                },
            };
            rows += 1;
            let label = numbers.row_label(row);
            match (mine.numbers[column].map(|n| n.mean), limit.map(|l| l * self.times)) {
                (Some(value), Some(limit)) if (if upper { value <= limit } else { value >= limit }) => {}
                (Some(value), Some(limit)) => {
                    against.push(format!("{label}: {value:.digits$} is {isnt} {limit:.digits$}"));
                }
                _ => against.push(format!("{label}: there is no number")),
            }
        }
        if rows == 0 {
            against.push("no row has it".into());
        }
        Ok(JudgedClaim { text, against })
    }
}

impl JudgedClaim {
    /// Returns the claim with what contradicts it, as a line.
    pub(super) fn line(&self) -> String {
        match self.against.is_empty() {
            true => format!("holds: {}", self.text),
            false => format!("DOES NOT HOLD: {} ({})", self.text, self.against.join("; ")),
        }
    }

    /// Returns it for programs.
    pub(super) fn json(&self) -> Value {
        json!({ "claim": self.text, "holds": self.against.is_empty(), "against": self.against })
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::{MeanOverSeeds, TableEntry};
    use super::*;

    #[test]
    fn a_claim_holds_or_names_the_rows_that_contradict_it() {
        let experiment: Experiment = toml::from_str(
            "title = 't'\n[rigs.r]\npreset = 'demo'\n[[cases]]\nlabel = 'a'\nrig = 'r'\nscene = 's'\n[[cases]]\nlabel = \
             'b'\nrig = 'r'\nscene = 's'\n[[methods]]\nlabel = 'm'\nrun = 'reconstruct'\n[[methods]]\nlabel = 'n'\nrun = \
             'decode'\n[[columns]]\nlabel = 'error'\nvalue = 'step.wall_secs'\ndigits = 1",
        )
        .unwrap();
        // Method m has 1 and 3, method n has 2 on the first row alone.
        let entry = |row, method, mean: Option<f64>| TableEntry {
            row,
            method,
            numbers: vec![mean.map(|mean| MeanOverSeeds { mean, spread: None, n: 1 })],
            problem: None,
        };
        let entries = vec![entry(0, 0, Some(1.0)), entry(0, 1, Some(2.0)), entry(1, 0, Some(3.0))];
        let mut numbers = ExperimentNumbers { experiment: &experiment, entries };
        let judged = |numbers: &ExperimentNumbers<'_>, says: &str| {
            let claim: Claim = toml::from_str(&format!("column = 'error'\nmethod = 'm'\n{says}")).unwrap();
            claim.check(&experiment).unwrap();
            claim.judge(numbers).unwrap()
        };
        assert_eq!(judged(&numbers, "at_most = 'n'").line(), "holds: error: m has at most that of n");
        assert_eq!(judged(&numbers, "at_most = 'n'\ntimes = 0.4").against, ["a: 1.0 is more than 0.8"]);
        assert_eq!(judged(&numbers, "at_most = 2.5").against, ["b: 3.0 is more than 2.5"]);
        assert!(judged(&numbers, "at_most = 2.5\ncases = ['a']").against.is_empty());
        assert_eq!(judged(&numbers, "at_least = 2").against, ["a: 1.0 is less than 2.0"]);
        assert_eq!(judged(&numbers, "at_most = 'n'\ncases = ['b']").against, ["no row has it"]);
        numbers.entries[1].numbers[0] = None;
        assert_eq!(judged(&numbers, "at_most = 'n'").against, ["a: there is no number"]);
    }
}
