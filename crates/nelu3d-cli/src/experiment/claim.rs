//! What an experiment claims: orderings of methods and bounds on numbers, checked whenever it runs.

use anyhow::{Result, bail};
use serde::Deserialize;

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

fn one() -> f64 {
    1.0
}

impl Claim {
    /// Fails if it bounds nothing, or names what is not among the labels of the columns, the methods, and the cases.
    pub(super) fn check(&self, columns: &[&str], methods: &[&str], cases: &[&str]) -> Result<()> {
        let column = &self.column;
        if !columns.contains(&column.as_str()) {
            bail!("a claim is about column `{column}`, which is not there");
        }
        let (_, bound) = self.bound()?;
        let compared = if let Bound::Method(label) = bound { Some(label) } else { None };
        for label in [Some(&self.method), compared].into_iter().flatten() {
            if !methods.contains(&label.as_str()) {
                bail!("the claim about `{column}`: there is no method `{label}`");
            }
        }
        if let Some(case) = self.cases.iter().find(|c| !cases.contains(&c.as_str())) {
            bail!("the claim about `{column}`: there is no case `{case}`");
        }
        Ok(())
    }

    /// Returns whether the bound is an upper one, and the bound.
    pub(super) fn bound(&self) -> Result<(bool, &Bound)> {
        match (&self.at_most, &self.at_least) {
            (Some(bound), None) => Ok((true, bound)),
            (None, Some(bound)) => Ok((false, bound)),
            _ => bail!("the claim about `{}` needs one of `at_most` and `at_least`", self.column),
        }
    }
}
