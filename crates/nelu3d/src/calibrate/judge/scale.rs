//! Whether the scale of everything is known: it rests on the print's measures, which no image tells, and on the focal
//! length. A stage of known step tells both.

use nelu3d_scan::pose::{SharedMisfit, Steps};

use crate::verdict::{Code, Finding, Verdict};

/// Relative standard deviation up to which the boards tell the focal length.
const KNOWN: f64 = 0.01;
/// Relative difference of steps from which the scale is wrong.
const MAX_DIFFERENCE: f64 = 0.005;
/// The same in standard deviations of the stage's own errors.
const MIN_SIGMAS: f64 = 5.0;

/// Judges the scale by the steps of a stage, as the poses of `n` boards have them and as they were stated; notes that
/// it was not checked where either is missing.
pub fn judge(misfit: Option<&SharedMisfit>, steps: Option<&Steps>, n: usize, step_mm: Option<f64>) -> Option<Finding> {
    match (steps, step_mm) {
        (Some(steps), Some(stated)) => contradicted(steps, n, stated),
        _ => Some(not_checked(misfit, step_mm.is_some())),
    }
}

/// Steps that are not as long as was stated.
fn contradicted(steps: &Steps, n: usize, stated_mm: f64) -> Option<Finding> {
    let scale = steps.mean_mm.abs() / stated_mm;
    // Of the slope of a line through evenly spaced points.
    let sigma = steps.deviation_mm / stated_mm * (12.0 / (n as f64).powi(3)).sqrt();
    ((scale - 1.0).abs() > MAX_DIFFERENCE.max(MIN_SIGMAS * sigma)).then(|| {
        let sentence = format!(
            "the boards' steps are {:.3} mm by [board] and camera.json, and {stated_mm:.3} mm by the stage: depths are {:.1} \
             % too {}",
            steps.mean_mm.abs(),
            100.0 * (scale - 1.0).abs(),
            if scale > 1.0 { "large" } else { "small" }
        );
        let remedy = "measure the print and correct [board], or calibrate the camera again";
        Finding::new(Code::ScaleContradicted, Verdict::Doubtful, sentence, remedy)
            .with("scale", scale)
            .with("step_mm", steps.mean_mm.abs())
            .with("stated_mm", stated_mm)
    })
}

/// Notes what no image tells: the scale of everything, and the focal length where the boards face the camera.
fn not_checked(misfit: Option<&SharedMisfit>, is_stated: bool) -> Finding {
    let sentence = "the scale of all depths rests on the size of the print in [board]";
    let sigma = misfit.map(|m| m.focal_sigma);
    let (mut sentence, remedy) = match sigma.filter(|s| *s <= KNOWN) {
        Some(_) => (format!("{sentence}, which no image tells"), "measure the print"),
        None => (
            format!("{sentence} and on the focal length in camera.json, which boards that face the camera do not tell"),
            "measure the print, and tilt the board by 20 degrees and more at some positions",
        ),
    };
    if is_stated {
        sentence += ", and the boards stand on no line that would show the stage's step";
    }
    Finding::new(Code::ScaleNotChecked, Verdict::Good, sentence, remedy).with("focal_sigma", sigma)
}
