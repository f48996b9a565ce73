//! `nelu3d check`: everything wrong with a rig folder, in one go.

use std::process::ExitCode;

use anyhow::Result;
use nelu3d_scan::rig::{Finding, Severity, check};

use crate::args::CheckArgs;
use crate::context::CommandContext;
use crate::paths::shown;

/// Runs the command. Errors make it fail; warnings do not.
pub(crate) fn run(args: CheckArgs, context: &CommandContext) -> Result<ExitCode> {
    context.progress.stage("check");
    let findings = check(&args.rig);
    let errors = findings.iter().filter(|f| f.severity == Severity::Error).count();
    let json = serde_json::json!({ "rig": shown(&args.rig), "ok": errors == 0, "findings": findings });
    context.answer(&json, || text(&shown(&args.rig), &findings, errors))?;
    Ok(if errors == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Returns the findings for people, one a line.
fn text(rig: &str, findings: &[Finding], errors: usize) -> String {
    if findings.is_empty() {
        return format!("{rig}: nothing is wrong");
    }
    let lines: Vec<String> = findings.iter().map(ToString::to_string).collect();
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let warnings = findings.len() - errors;
    format!("{}\n{rig}: {}, {}", lines.join("\n"), count(errors, "error"), count(warnings, "warning"))
}
