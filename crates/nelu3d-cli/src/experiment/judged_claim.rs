//! A claim of an experiment, held against its numbers.

use anyhow::Result;
use serde_json::{Value, json};

use super::claim::{Bound, Claim};
use super::table::ExperimentNumbers;

/// A claim, and the rows that contradict it.
pub(super) struct JudgedClaim {
    /// The claim as a sentence.
    pub text: String,
    /// What contradicts it: empty if it holds.
    pub against: Vec<String>,
}

impl JudgedClaim {
    /// Compares a claim with the numbers. A row on which one of the two methods does not run is no part of it; one on
    /// which it ran and has no number contradicts it, and a claim that no row is part of does not hold.
    pub(super) fn of(claim: &Claim, numbers: &ExperimentNumbers<'_>) -> Result<Self> {
        let experiment = numbers.experiment;
        let (upper, bound) = claim.bound()?;
        let (is, isnt) = if upper { ("at most", "more than") } else { ("at least", "less than") };
        let column = experiment.columns.iter().position(|c| c.label == claim.column).unwrap_or_default();
        let digits = experiment.columns[column].digits;
        let method = |label: &str| experiment.methods.iter().position(|m| m.label == label).unwrap_or_default();
        let times = if claim.times == 1.0 { String::new() } else { format!("{} × ", claim.times) };
        let what = match bound {
            Bound::Number(limit) => format!("{}", limit * claim.times),
            Bound::Method(other) => format!("{times}that of {other}"),
        };
        let cases = if claim.cases.is_empty() { String::new() } else { format!(" on {}", claim.cases.join("; ")) };
        let text = format!("{}: {} has {is} {what}{cases}", claim.column, claim.method);

        let (mut against, mut rows) = (Vec::new(), 0);
        for row in 0..numbers.n_rows() {
            if !claim.cases.is_empty() && !claim.cases.contains(numbers.case_label(row)) {
                continue;
            }
            let Some(mine) = numbers.entry(row, method(&claim.method)) else { continue };
            let limit = match bound {
                Bound::Number(limit) => Some(*limit),
                Bound::Method(other) => match numbers.entry(row, method(other)) {
                    Some(entry) => entry.numbers[column].map(|n| n.mean),
                    None => continue,
                },
            };
            rows += 1;
            let label = numbers.row_label(row);
            match (mine.numbers[column].map(|n| n.mean), limit.map(|l| l * claim.times)) {
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
        Ok(Self { text, against })
    }

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
    use super::super::file::Experiment;
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
            JudgedClaim::of(&claim, numbers).unwrap()
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
