//! `nelu3d projector`: the projector is calibrated from the rig's own sweep.

use std::path::PathBuf;

use anyhow::Result;
use nelu3d_baselines::projector::{self, ProjectorReport, calibrate_projector};
use nelu3d_scan::Rig;
use nelu3d_scan::output::ReservedPath;
use nelu3d_scan::rig::PROJECTOR_FILE;

use crate::args::ProjectorArgs;
use crate::context::CommandContext;
use crate::paths::shown;

/// Runs the command.
pub(crate) fn run(args: ProjectorArgs, context: &CommandContext) -> Result<()> {
    let rig = Rig::open(&args.rig)?;
    let output: PathBuf = args.output.unwrap_or_else(|| rig.root.join(PROJECTOR_FILE));
    if output.exists() && !args.force {
        anyhow::bail!("{}: exists; give --force to replace it, or another file with -o FILE", shown(&output));
    }
    // Before the work: it must not end at a file that cannot be written.
    let _reserved = ReservedPath::new(&output)?;
    let (projector, report) = calibrate_projector(&rig, args.set.as_deref(), &args.options, &context.progress)?;
    context.stop_if_asked()?;
    projector::write(&output, &projector, &report)?;
    context.answer(&serde_json::json!({ "projector": shown(&output), "report": report }), || {
        format!("{}projector {}", text(&report), shown(&output))
    })?;
    Ok(())
}

/// Returns the report for people.
fn text(r: &ProjectorReport) -> String {
    let [x, y, z] = r.center_mm;
    let [sx, sy, sz] = r.center_sigma_mm;
    let [near, far] = r.depth_mm;
    let mut text = format!(
        "corners   {} at {} positions, {:.0} to {:.0} mm deep ({} rejected)\nreproject {:.3} px RMS\ncenter    at \
         ({x:.1} ± {sx:.1}, {y:.1} ± {sy:.1}, {z:.1} ± {sz:.1}) mm\n",
        r.corners, r.positions, near, far, r.rejected, r.rms_px
    );
    if let Some(response) = &r.response {
        text += &format!("response  about v^{:.2}, from {}\n", response.gamma, response.images.join(", "));
    }
    text
}
