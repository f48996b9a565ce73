//! `nelu3d import`: recorded folders of frames become part of a rig.

use anyhow::Result;
use nelu3d_scan::import::{self, ImportError, ImportReport, ImportRequest, ImportTarget};

use crate::args::ImportArgs;
use crate::context::CommandContext;
use crate::paths::shown;

/// Runs the command.
pub(crate) fn run(args: ImportArgs, context: &CommandContext) -> Result<()> {
    // Exactly one of the three was typed.
    let target = match (args.sequence, args.scene) {
        (Some(name), _) => ImportTarget::Sequence(name),
        (_, Some(name)) => ImportTarget::Scene(name),
        _ => ImportTarget::Calibration,
    };
    let request = ImportRequest {
        frames: args.frames,
        rig: args.rig,
        target,
        order: args.order,
        set: args.set,
        first: args.first.map(|n| n as usize),
        last: args.last.map(|n| n as usize),
        every: args.every as usize,
        mean: args.mean,
        black: args.black,
        camera: args.sensor.camera,
        channels: args.sensor.channels,
        black_level: args.sensor.black_level,
        saturation: args.sensor.saturation,
        force: args.force,
    };
    let progress = &context.progress;
    progress.stage("import frames");
    let report = import::run(&request, &|done, total| {
        progress.tick(done, total);
        !progress.cancelled()
    });
    let report = match report {
        Err(ImportError::Stopped) => anyhow::bail!("stopped"),
        other => other?,
    };
    for note in &report.notes {
        progress.warn(note);
    }
    context.answer(&report, || text(&report))?;
    Ok(())
}

/// Returns the report for people.
fn text(r: &ImportReport) -> String {
    let order: Vec<&str> = r.order.iter().map(|name| name.as_deref().unwrap_or("skip")).collect();
    let [first, last] = &r.range;
    let mut text = format!("frames    {}, {first} to {last}\norder     {}\n", r.frames, order.join(", "));
    if r.new_rig {
        let levels = r.levels.as_deref().map(|reason| format!(" ({reason})")).unwrap_or_default();
        text +=
            &format!("new rig   {}, black level {}, saturation {}{levels}\n", r.channels, r.black_level, r.saturation);
    }
    let folders = match r.folders {
        1 if r.groups > 1 => format!("1 folder, the mean of {} groups", r.groups),
        1 => "1 folder".into(),
        n => format!("{n} folders"),
    };
    text + &format!("written   {}, {folders}", shown(&r.output))
}
