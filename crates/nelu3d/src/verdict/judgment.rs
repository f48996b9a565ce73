//! Findings, and the verdict that follows from them.

use std::fmt;

use serde::Serialize;

use super::code::Code;

/// Whether to trust a result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Nothing that was measured speaks against it.
    #[default]
    Good,
    /// Something that was measured speaks against it.
    Doubtful,
    /// It is wrong.
    Bad,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Verdict::Good => "good",
            Verdict::Doubtful => "doubtful",
            Verdict::Bad => "bad",
        })
    }
}

/// One thing that was found.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// What it is about.
    pub code: Code,
    /// What it makes of the result.
    pub verdict: Verdict,
    /// What is wrong, in one sentence without a full stop.
    pub sentence: String,
    /// The numbers that say so, by name; names carry their units.
    pub evidence: serde_json::Map<String, serde_json::Value>,
    /// What to do.
    pub remedy: String,
}

impl Finding {
    /// Makes a finding.
    pub fn new(code: Code, verdict: Verdict, sentence: impl Into<String>, remedy: impl Into<String>) -> Self {
        let evidence = serde_json::Map::new();
        Self { code, verdict, sentence: sentence.into(), evidence, remedy: remedy.into() }
    }

    /// Adds a number or a name to the evidence.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<serde_json::Value>) -> Self {
        self.evidence.insert(name.into(), value.into());
        self
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} [{}]", self.sentence, self.remedy, self.code.name())
    }
}

/// A verdict, and what it rests on.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Judgment {
    /// The verdict: that of the worst finding.
    pub verdict: Verdict,
    /// What speaks against the result, the worst first.
    pub warnings: Vec<Finding>,
    /// What is worth knowing and does not speak against it.
    pub notes: Vec<Finding>,
}

impl Judgment {
    /// Adds a finding: a note if its own verdict is good, else a warning.
    pub fn add(&mut self, finding: Finding) {
        self.verdict = self.verdict.max(finding.verdict);
        if finding.verdict == Verdict::Good {
            self.notes.push(finding);
        } else {
            let at = self.warnings.partition_point(|w| w.verdict >= finding.verdict);
            self.warnings.insert(at, finding);
        }
    }

    /// Adds findings.
    pub fn extend(&mut self, findings: impl IntoIterator<Item = Finding>) {
        findings.into_iter().for_each(|f| self.add(f));
    }

    /// Returns the verdict and what it rests on, in one line.
    pub fn line(&self) -> String {
        let codes: Vec<String> = self.warnings.iter().map(|w| w.code.name()).collect();
        if codes.is_empty() { self.verdict.to_string() } else { format!("{} ({})", self.verdict, codes.join(", ")) }
    }
}
