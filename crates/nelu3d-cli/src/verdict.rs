//! How a verdict is told: its first line in the report, every warning with what to do, and what is refused.

use nelu3d::verdict::{Judgment, Verdict};

use crate::context::CommandContext;

/// Shows every warning on standard error.
pub(crate) fn show(judgment: &Judgment, context: &CommandContext) {
    for warning in &judgment.warnings {
        context.progress.warn(warning.to_string());
    }
}

/// Returns the first line of a report.
pub(crate) fn first_line(judgment: &Judgment) -> String {
    format!("verdict   {}\n", judgment.line())
}

/// Returns whether a result is so bad that it is not written unless that is accepted.
pub(crate) fn refused(judgment: &Judgment, accept: bool) -> bool {
    judgment.verdict == Verdict::Bad && !accept
}

/// Returns why nothing was written, in one sentence; `what` names the result.
pub(crate) fn refusal(judgment: &Judgment, what: &str) -> String {
    let why = judgment.warnings.first().map_or_else(|| "it is bad".into(), ToString::to_string);
    format!("{what} was not written: {why}; --accept writes it all the same")
}
