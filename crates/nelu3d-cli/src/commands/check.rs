//! `nelu3d check`: everything wrong with a rig folder, in one go; with `--drift`, whether something moved since the sweep.

use std::path::Path;

use anyhow::{Result, bail};
use nelu3d::ColorField;
use nelu3d::drift::{DriftReport, Moved, check_drift, correct};
use nelu3d::verdict::Judgment;
use nelu3d_scan::Rig;
use nelu3d_scan::rig::{Finding, PatternSet, Severity, Shot, check};

use crate::args::CheckArgs;
use crate::context::CommandContext;
use crate::paths::{default_field, load_field, shown};
use crate::verdict;

/// Runs the command, and returns whether the rig is without errors; warnings do not count.
pub(crate) fn run(args: CheckArgs, context: &CommandContext) -> Result<bool> {
    if !args.drift.is_empty() {
        // What moved is a warning.
        return drift(&args, context).map(|()| true);
    }
    context.progress.stage("check");
    let findings = check(&args.rig);
    let errors = findings.iter().filter(|f| f.severity == Severity::Error).count();
    let json = serde_json::json!({ "rig": shown(&args.rig), "ok": errors == 0, "findings": findings });
    context.answer(&json, || text(&shown(&args.rig), &findings, errors))?;
    Ok(errors == 0)
}

/// Checks whether camera or light moved since the sweep; writes the corrected field where that is asked for.
fn drift(args: &CheckArgs, context: &CommandContext) -> Result<()> {
    let rig = Rig::open(&args.rig)?;
    let set = rig.pattern_set(args.set.as_deref())?;
    let shots = args.drift.iter().map(|name| rig.scene(name)).collect::<Result<Vec<Shot>, _>>()?;
    let path = args.field.clone().unwrap_or_else(|| default_field(&rig, &set.name));
    let field = load_field(&rig, set, &path)?;
    let report = check_drift(&rig, set, &shots, &field, &context.progress)?;
    let mut judgment = Judgment::default();
    judgment.extend(report.finding());
    verdict::show(&judgment, context);
    if let Some(output) = &args.correct {
        let corrected = corrected(&report, &rig, &shots[0], field)?;
        context.stop_if_asked()?;
        corrected.save(output)?;
    }
    let json = serde_json::json!({
        "rig": shown(&args.rig),
        "verdict": judgment.verdict,
        "warnings": judgment.warnings,
        "drift": report,
        "field": args.correct.as_ref().map(|f| shown(f)),
    });
    context.answer(&json, || verdict::first_line(&judgment) + &drift_text(&report, args.correct.as_deref()))?;
    Ok(())
}

/// Returns what a check for drift measured, for people.
fn drift_text(report: &DriftReport, corrected: Option<&Path>) -> String {
    let mut text = format!("board     corners fit to {:.2} px", report.corner_rms_px);
    text += &match (&report.position, report.corners_px) {
        (Some(position), Some([x, y])) => {
            format!(", {:.2} px from where they were at position {position} of the sweep\n", x.hypot(y))
        }
        _ => ", elsewhere than in the sweep\n".into(),
    };
    text += &format!("light     falls {:.2} px beside where the sweep says, on the board\n", report.shift_px);
    if let Some(output) = corrected {
        text += &format!("field     {}\n", shown(output));
    }
    text
}

/// Returns a field corrected for what the board in a scene tells to have moved; the field itself if nothing did.
pub(super) fn corrected_field(
    rig: &Rig,
    set: &PatternSet,
    shot: &Shot,
    field: ColorField,
    context: &CommandContext,
) -> Result<ColorField> {
    let report = check_drift(rig, set, std::slice::from_ref(shot), &field, &context.progress)?;
    corrected(&report, rig, shot, field)
}

/// Returns a field corrected for what a report says: the field itself if nothing moved. Fails if no rigid motion
/// explains what changed.
fn corrected(report: &DriftReport, rig: &Rig, shot: &Shot, field: ColorField) -> Result<ColorField> {
    if report.moved == Moved::Nothing {
        return Ok(field);
    }
    if !report.rigid {
        let why = report.finding().map_or_else(String::new, |f| format!("{}: {}", f.sentence, f.remedy));
        bail!("{}: the color field cannot be corrected: {why}", shown(&shot.dir));
    }
    Ok(correct(&field, &report.motion, &rig.camera))
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
