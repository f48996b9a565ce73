//! Errors as people read them: one sentence in one line, with what to type at the command line.
//!
//! Libraries say what is wrong in words that hold for every caller. This is the one place that knows which command or
//! option helps against which of their errors.

use std::error::Error;

use nelu3d::color_field::FieldMismatch;
use nelu3d::color_field::checkpoint::CheckpointError;
use nelu3d::{CalibrationError, ReconstructionError};
use nelu3d_baselines::DecodeError;
use nelu3d_baselines::lookup3d::LookupTableError;
use nelu3d_evaluate::cad::CadError;

const NEW_FIELD: &str = "`nelu3d calibrate` makes a new field, --field gives another one";
const FROM_PROJECTOR: &str = "--from-projector takes a calibrated projector instead";

/// Returns an error and its causes as one sentence, in one line. A cause that the sentence already says is not
/// repeated.
pub(crate) fn sentence(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(|e| one_line(&with_options(&e.to_string()))) {
        if !text.contains(&cause) {
            if !text.is_empty() {
                text.push_str(": ");
            }
            text.push_str(&cause);
        }
    }
    // What is named already need not be named again.
    match error.chain().find_map(hint) {
        Some((word, hint)) if !text.contains(word) => format!("{text}; {hint}"),
        _ => text,
    }
}

/// Returns a text of a library with its settings named as they are typed: `--min-contrast` for "setting
/// `min_contrast`".
fn with_options(text: &str) -> String {
    const SETTING: &str = "setting `";
    let mut parts = text.split(SETTING);
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        match part.split_once('`') {
            Some((name, rest)) => out += &format!("--{}{rest}", name.replace('_', "-")),
            None => out += &format!("{SETTING}{part}"),
        }
    }
    out
}

/// Returns what to type about an error, if that helps, after the word of it that tells whether a message has it
/// already.
fn hint(error: &(dyn Error + 'static)) -> Option<(&'static str, String)> {
    if let Some(mismatch) = error.downcast_ref() {
        return mismatch_hint(mismatch);
    }
    match error.downcast_ref() {
        Some(ReconstructionError::Mismatch(mismatch)) => return mismatch_hint(mismatch),
        Some(ReconstructionError::Nothing { reason, .. }) if reason.contains("diverged") => {
            return Some(("--seed", "try another --seed or --start".into()));
        }
        _ => {}
    }
    if let Some(CheckpointError::Read { .. } | CheckpointError::Malformed { .. }) = error.downcast_ref() {
        return Some(("nelu3d calibrate", NEW_FIELD.into()));
    }
    if let Some(calibration) = error.downcast_ref() {
        return calibration_hint(calibration);
    }
    match error.downcast_ref() {
        Some(DecodeError::Unsuited { .. }) => return Some(("--method", "choose another --method".into())),
        Some(DecodeError::Lookup3d(table)) => return table_hint(table),
        _ => {}
    }
    if let Some(table) = error.downcast_ref() {
        return table_hint(table);
    }
    match error.downcast_ref()? {
        CadError::Unit { suggestion, .. } => Some(("--scale", format!("that is --scale {suggestion}"))),
        CadError::NoPose { .. } => {
            Some(("--scale", "options --scale, --initial-pose and --no-align say what is known".into()))
        }
        _ => None,
    }
}

/// A pattern that was taken differently in the sweep needs another capture; everything else another field.
fn mismatch_hint(mismatch: &FieldMismatch) -> Option<(&'static str, String)> {
    (mismatch.what != "the image").then(|| ("nelu3d calibrate", NEW_FIELD.into()))
}

fn calibration_hint(error: &CalibrationError) -> Option<(&'static str, String)> {
    match error {
        CalibrationError::NoBoard(_) => Some(("--from-projector", FROM_PROJECTOR.into())),
        CalibrationError::Projector { reason, .. } if reason.contains("depth") || reason.contains("overlap") => {
            Some(("--depth", "--depth NEAR FAR gives the range, mm".into()))
        }
        CalibrationError::Projector { reason, .. } if reason.contains("missing") => {
            Some(("nelu3d projector", "`nelu3d projector` calibrates it".into()))
        }
        _ => None,
    }
}

fn table_hint(error: &LookupTableError) -> Option<(&'static str, String)> {
    match error {
        LookupTableError::Calibrate(e) => calibration_hint(e),
        LookupTableError::PreviousSize { .. } => Some(("--previous", "--previous takes such a result".into())),
        LookupTableError::Memory { stride, .. } => Some(("--stride", format!("give --stride {stride}"))),
        LookupTableError::Stride(_) => Some(("--stride", "correct --stride".into())),
        _ => None,
    }
}

/// Returns the text without line breaks and other control characters, which file names and parsers' messages may bring
/// in.
fn one_line(text: &str) -> String {
    text.split(char::is_control).map(str::trim).filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_said_once() {
        let e = anyhow::anyhow!("no such file").context("a.png: no such file").context("cannot read the scene");
        assert_eq!(sentence(&e), "cannot read the scene: a.png: no such file");
    }

    #[test]
    fn a_sentence_is_one_line() {
        let e = anyhow::anyhow!("line 3:\n  | x = \r\n  |   ^ odd\n").context("\x1b[31mrig.toml");
        assert_eq!(sentence(&e), "[31mrig.toml: line 3: | x = |   ^ odd");
    }

    #[test]
    fn settings_are_named_as_they_are_typed() {
        assert_eq!(with_options("give setting `min_contrast` or a `b`"), "give --min-contrast or a `b`");
        assert_eq!(with_options("setting `open"), "setting `open");
        let e = DecodeError::Setting { setting: "gamma", problem: "is -1: give a positive number".into() };
        assert_eq!(sentence(&e.into()), "--gamma is -1: give a positive number");
    }

    /// What the libraries leave open, the program says, and once only.
    #[test]
    fn options_that_help_are_named_once() {
        let mismatch = || FieldMismatch {
            what: "the camera",
            field: "a".into(),
            rig: "b".into(),
            remedy: "calibrate this rig and set again",
        };
        let checkpoint = CheckpointError::Malformed { path: "f.safetensors".into(), reason: "short".into() };
        for (error, option) in [
            (anyhow::Error::from(mismatch()), "nelu3d calibrate"),
            (anyhow::Error::from(mismatch()).context("fields/a.safetensors"), "nelu3d calibrate"),
            (ReconstructionError::Mismatch(mismatch()).into(), "nelu3d calibrate"),
            (checkpoint.into(), "nelu3d calibrate"),
            (CalibrationError::NoBoard("rig.toml".into()).into(), "--from-projector"),
            (LookupTableError::Stride(99).into(), "--stride"),
            (CadError::Unit { mesh_mm: 0.1, scan_mm: 100.0, suggestion: 1000.0 }.into(), "--scale 1000"),
            (CadError::NoPose { on_mesh: 0.1, on: 0.1, in_front: 0.5, tolerance_mm: 1.0 }.into(), "--initial-pose"),
        ] {
            let text = sentence(&error);
            assert_eq!(text.matches(option).count(), 1, "{text}");
        }
    }
}
