//! `nelu3d calibrate`: a board sweep becomes a color field.

use std::path::{Path, PathBuf};

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
use crate::verdict;

/// Runs the command.
pub(crate) fn run(args: CalibrateArgs, context: &CommandContext) -> Result<()> {
    let rig = Rig::open(&args.rig)?;
    let set = rig.pattern_set(args.set.as_deref())?;
    context.open_device(args.options.device)?;
    let output: PathBuf = args.output.unwrap_or_else(|| default_field(&rig, &set.name));
    let job = CalibrationJob {
        options: &args.options,
        from_projector: args.from_projector.then_some(&args.projector),
        colors: args.colors.as_deref(),
        accept: args.accept,
    };
    let (report, crosstalk) = job.run(&rig, set, &output, context)?;
    verdict::show(&report.judgment, context);
    let refused = verdict::refused(&report.judgment, args.accept);
    let bytes = std::fs::metadata(&output).map(|m| m.len()).ok().filter(|_| !refused);
    let cpu_secs: f64 = report.stages.iter().map(|s| s.cpu_secs).sum();
    let answer = serde_json::json!({
        "verdict": report.judgment.verdict,
        "warnings": report.judgment.warnings,
        "notes": report.judgment.notes,
        "field": (!refused).then(|| shown(&output)),
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
        let end = if refused { String::new() } else { format!("field     {}", shown(&output)) };
        format!("{}{}{end}", text(&report), crosstalk.unwrap_or_default())
    })?;
    if refused {
        bail!("{}", verdict::refusal(&report.judgment, &shown(&output)));
    }
    Ok(())
}

/// Calibrates from the sweep and writes the field.
pub(crate) fn calibrate_to(
    rig: &Rig,
    set: &PatternSet,
    options: &CalibrationOptions,
    output: &Path,
    context: &CommandContext,
) -> Result<CalibrationReport> {
    let job = CalibrationJob { options, from_projector: None, colors: None, accept: false };
    let (report, _) = job.run(rig, set, output, context)?;
    verdict::show(&report.judgment, context);
    if verdict::refused(&report.judgment, false) {
        bail!("{}", verdict::refusal(&report.judgment, &shown(output)));
    }
    Ok(report)
}

/// What a calibration is made with.
struct CalibrationJob<'a> {
    options: &'a CalibrationOptions,
    /// Settings of a field from the projector, if it is asked for.
    from_projector: Option<&'a FromProjectorOptions>,
    /// Scene that the crosstalk of the camera's channels is measured on.
    colors: Option<&'a str>,
    /// Whether a bad field is written all the same.
    accept: bool,
}

impl CalibrationJob<'_> {
    /// Calibrates, and writes the field unless it is bad. Returns the report and the crosstalk.
    fn run(
        &self,
        rig: &Rig,
        set: &PatternSet,
        output: &Path,
        context: &CommandContext,
    ) -> Result<(CalibrationReport, Option<CrosstalkMatrix>)> {
        let Self { options, from_projector, colors, accept } = *self;
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
                context
                    .progress
                    .warn(format!("{}: shows no crosstalk, or too few saturated colors", shown(&scene.dir)));
            }
            field.metadata.crosstalk = found;
        }
        context.stop_if_asked()?;
        if !verdict::refused(&report.judgment, accept) {
            field.save(output)?;
        }
        Ok((report, field.metadata.crosstalk))
    }
}

/// Returns the report for people.
fn text(report: &CalibrationReport) -> String {
    let mut text = verdict::first_line(&report.judgment);
    if let Some(boards) = &report.boards_mm {
        text += &format!("boards    from {:.0} to {:.0} mm of depth", boards.near_mm, boards.far_mm);
        text += &report.corner_rms_px.map(|rms| format!(", corners fit to {rms:.2} px\n")).unwrap_or("\n".into());
    }
    if let Some(flatness) = report.trajectory.as_ref().and_then(|t| t.flatness.as_ref()).filter(|f| f.bend.is_some()) {
        let ([x, y], [dx, dy]) = (flatness.sagitta_mm, flatness.sigma_mm);
        text += &format!(
            "board     bent by {x:.2} ± {dx:.2} mm along x and {y:.2} ± {dy:.2} mm along y, which is taken into account\n"
        );
    }
    if let Some(refined) = &report.refined_poses {
        text += &format!(
            "poses     refined on codewords: boards moved by up to {:.2} mm (rms {:.2} mm); held-out boards are off by {:.2} \
             mm, {:.2} before\n",
            refined.largest_mm, refined.rms_mm, refined.off_mm, refined.off_before_mm
        );
        if let Some(relief) = &refined.relief {
            text += &format!(
                "board     not flat by up to {:.2} mm (rms {:.2} mm), as codewords tell, which is taken into account\n",
                relief.largest_mm, relief.rms_mm
            );
        }
    }
    if let Some(at) = report.light_mm {
        text += &format!("light     {}\n", whereabouts(at));
    }
    text += &format!("frame     {}\n", report.frame);
    let [a, b, w] = report.cells;
    text += &format!("cells     {a} × {b} × {w}\n");
    if let Some(carried) = &report.carried {
        text += &format!(
            "stripes   {:.0} % of the rays met no bright sample: their codewords come from beside them (error {:.3})\n",
            100.0 * carried.share,
            carried.rms
        );
        if carried.one_axis > 5e-4 {
            text += &format!(
                "          {:.1} % more are known along one axis of the code only\n",
                100.0 * carried.one_axis
            );
        }
    }
    if let Some(q) = &report.quality {
        text += &format!(
            "held out  {} positions: {:.1} dB (noise alone: about {:.1} dB), median depth error {:.3} mm\n",
            q.held_out.len(),
            q.psnr_db,
            q.ceiling_db,
            q.depth_mm
        );
        if let Some(pixels) = q.pixels {
            text += &format!("          random samples of the other positions: {:.1} dB\n", pixels.psnr_db);
        }
    }
    for note in &report.judgment.notes {
        text += &format!("note      {note}\n");
    }
    text
}

/// Says where a point is as seen from the camera (x right, y down, z forward), mm, so that a wrong scale meets the eye.
fn whereabouts([x, y, z]: [f64; 3]) -> String {
    let part = |v: f64, positive: &str, negative: &str| {
        format!("{:.0} mm {}", v.abs(), if v < 0.0 { negative } else { positive })
    };
    format!(
        "{}, {}, {} the camera, at ({x:.0}, {y:.0}, {z:.0}) mm",
        part(x, "to the right", "to the left"),
        part(y, "below", "above"),
        part(z, "before", "behind")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_light_is_described_as_seen_from_the_camera() {
        let text = whereabouts([-89.2, -622.0, 245.0]);
        assert_eq!(text, "89 mm to the left, 622 mm above, 245 mm before the camera, at (-89, -622, 245) mm");
    }
}
