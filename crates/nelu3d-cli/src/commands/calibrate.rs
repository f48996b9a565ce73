//! `nelu3d calibrate`: a board sweep becomes a color field.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, bail};
use nelu3d::from_projector::{FromProjectorOptions, calibrate_from_projector};
use nelu3d::sensor::CrosstalkMatrix;
use nelu3d::{CalibrationOptions, CalibrationReport, ReconstructionOptions, calibrate, reconstruct};
use nelu3d_scan::Rig;
use nelu3d_scan::output::ReservedPath;
use nelu3d_scan::rig::PatternSet;

use crate::args::CalibrateArgs;
use crate::context::CommandContext;
use crate::paths::{default_field, shown};

/// Runs the command.
pub(crate) fn run(args: CalibrateArgs, context: &CommandContext) -> Result<ExitCode> {
    let rig = Rig::open(&args.rig)?;
    let set = rig.pattern_set(args.set.as_deref())?;
    context.open_device(args.options.device)?;
    let output: PathBuf = args.output.unwrap_or_else(|| default_field(&rig, &set.name));
    let from_projector = args.from_projector.then_some(&args.projector);
    let (report, crosstalk) =
        calibrate_with(&rig, set, &args.options, from_projector, args.colors.as_deref(), &output, context)?;
    let bytes = std::fs::metadata(&output).map(|m| m.len()).ok();
    let cpu_secs: f64 = report.stages.iter().map(|s| s.cpu_secs).sum();
    let answer = serde_json::json!({
        "field": shown(&output),
        "field_bytes": bytes,
        "cpu_secs": cpu_secs,
        "peak_memory_bytes": nelu3d::result::peak_memory_bytes(),
        "report": report,
        "mixing": crosstalk,
    });
    context.answer(&answer, || {
        let crosstalk = crosstalk.map(|m| {
            let row = |r: &[f32; 3]| r.map(|v| format!("{v:.3}")).join(" ");
            format!("crosstalk {}\n", m.0.iter().map(row).collect::<Vec<_>>().join(" | "))
        });
        format!("{}{}field     {}", text(&report), crosstalk.unwrap_or_default(), shown(&output))
    })?;
    Ok(ExitCode::SUCCESS)
}

/// Calibrates from the sweep and writes the field.
pub(crate) fn calibrate_to(
    rig: &Rig,
    set: &PatternSet,
    options: &CalibrationOptions,
    output: &Path,
    context: &CommandContext,
) -> Result<CalibrationReport> {
    Ok(calibrate_with(rig, set, options, None, None, output, context)?.0)
}

/// Calibrates and writes the field, from the projector if asked for, with the crosstalk of the camera's channels
/// measured on the scene `colors`. Returns the report and that crosstalk.
fn calibrate_with(
    rig: &Rig,
    set: &PatternSet,
    options: &CalibrationOptions,
    from_projector: Option<&FromProjectorOptions>,
    colors: Option<&str>,
    output: &Path,
    context: &CommandContext,
) -> Result<(CalibrationReport, Option<CrosstalkMatrix>)> {
    // Before the work: it must not end at a file that cannot be written.
    let _reserved = ReservedPath::new(output)?;
    let scene = colors.map(|name| rig.scene(name)).transpose()?;
    if scene.is_some() && rig.channels.count() != 3 {
        bail!("{}: --colors is for color cameras, but this one has one channel", shown(&rig.root));
    }
    let (mut field, report) = match from_projector {
        Some(settings) => calibrate_from_projector(rig, set, settings, &context.progress)?,
        None => calibrate(rig, set, options, &context.progress)?,
    };
    if let Some(scene) = scene {
        let options = ReconstructionOptions { device: options.device, ..Default::default() };
        let found = reconstruct(rig, set, &scene, &field, &options, &context.progress)?.diagnostics.crosstalk();
        if found.is_none_or(|m| m == CrosstalkMatrix::NONE) {
            context.progress.warn(format!("{}: shows no crosstalk, or too few saturated colors", shown(&scene.dir)));
        }
        field.metadata.crosstalk = found;
    }
    context.stop_if_asked()?;
    field.save(output)?;
    Ok((report, field.metadata.crosstalk))
}

/// Returns the report for people.
fn text(report: &CalibrationReport) -> String {
    let mut text = format!("frame     {}\n", report.frame);
    if let Some([x, y, z]) = report.light_mm {
        text += &format!("light     at ({x:.0}, {y:.0}, {z:.0}) mm\n");
    }
    if let Some(flatness) = report.trajectory.as_ref().and_then(|t| t.flatness.as_ref()).filter(|f| f.bend.is_some()) {
        let ([x, y], [dx, dy]) = (flatness.sagitta_mm, flatness.sigma_mm);
        text += &format!(
            "board     bent by {x:.2} ± {dx:.2} mm along x and {y:.2} ± {dy:.2} mm along y, which is taken into account\n"
        );
    }
    let [a, b, w] = report.cells;
    text += &format!("cells     {a} × {b} × {w}\n");
    if let Some(q) = &report.quality {
        text += &format!(
            "held out  {} positions: {:.1} dB (noise alone: about {:.1} dB), median depth error {:.3} mm\n",
            q.held_out.len(),
            q.psnr_db,
            q.ceiling_db,
            q.depth_mm
        );
    }
    text
}
