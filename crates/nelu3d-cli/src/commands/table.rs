//! `nelu3d table`: lookup tables to and from the files of the LookUp3D tools.

use anyhow::Result;
use nelu3d::CalibrationOptions;
use nelu3d::progress::StageClock;
use nelu3d::result::peak_memory_bytes;
use nelu3d_baselines::lookup3d::{build, compress, file};
use nelu3d_scan::Rig;
use nelu3d_scan::output::ReservedPath;
use serde_json::json;

use crate::args::{TableArgs, TableCommand, TableExportArgs, TableInfoArgs};
use crate::context::CommandContext;
use crate::paths::shown;

/// Runs the command.
pub(crate) fn run(args: TableArgs, context: &CommandContext) -> Result<()> {
    match args.command {
        TableCommand::Export(args) => export(args, context)?,
        TableCommand::Info(args) => info(args, context)?,
    }
    Ok(())
}

/// Builds the table of a sweep and writes it, compressed if asked for.
fn export(args: TableExportArgs, context: &CommandContext) -> Result<()> {
    let wanted = if args.low_rank.is_some() { "npz" } else { "npy" };
    if args.output.extension().is_none_or(|e| e != wanted) {
        let kind = if args.low_rank.is_some() { "with --low-rank it is" } else { "without --low-rank it is" };
        anyhow::bail!("{}: the name of a table ends in .{wanted} ({kind} an .{wanted} file)", shown(&args.output));
    }
    let rig = Rig::open(&args.rig)?;
    let set = rig.pattern_set(args.set.as_deref())?;
    // Before the work: it must not end at a file that cannot be written.
    let _reserved = ReservedPath::new(&args.output)?;
    let mut clock = StageClock::new(&context.progress);
    let built = build(&rig, set, args.stride, &CalibrationOptions::default(), &context.progress, &mut clock)?;
    context.stop_if_asked()?;
    let mut lost = None;
    match args.low_rank {
        None => {
            clock.begin("write the table");
            file::write_npy(&built.table, &args.output)?;
        }
        Some(rank) => {
            clock.begin("compress the table");
            let compressed = compress(&built.table, rank);
            context.stop_if_asked()?;
            clock.begin("write the table");
            file::write_npz(&compressed.table, &args.output)?;
            lost = Some(compressed);
        }
    }
    let stages = clock.finish();
    let s = built.table.shape;
    let bytes = std::fs::metadata(&args.output).map_or(0, |m| m.len());
    let answer = json!({
        "table": shown(&args.output), "bytes": bytes, "width": s.width, "height": s.height, "stride": s.step,
        "positions": s.n_positions, "channels": s.k, "noise": built.table.variance.sqrt(),
        "rank": lost.as_ref().map(|c| c.table.rank), "depth_rank": lost.as_ref().map(|c| c.table.depth_rank),
        "lost": lost.as_ref().map(|c| &c.rms), "lost_depth_mm": lost.as_ref().map(|c| c.depth_rms_mm),
        "stages": stages, "peak_memory_bytes": peak_memory_bytes(),
    });
    context.answer(&answer, || {
        let mut text = format!(
            "table     {} × {} pixels × {} positions × ({} channels + depth)\nnoise     {:.4} (1σ of a well-lit entry)\n",
            s.width,
            s.height,
            s.n_positions,
            s.k,
            built.table.variance.sqrt()
        );
        if let Some(c) = &lost {
            let rms = c.rms.iter().copied().fold(0.0, f64::max);
            text += &format!(
                "rank      {} per channel (loses {rms:.4} RMS at most), {} of the depth ({:.4} mm)\n",
                c.table.rank, c.table.depth_rank, c.depth_rms_mm
            );
        }
        text + &format!("file      {} ({:.1} MB)", shown(&args.output), bytes as f64 / 1e6)
    })
}

/// Describes a file.
fn info(args: TableInfoArgs, context: &CommandContext) -> Result<()> {
    let info = file::info(&args.file)?;
    context.answer(&info, || {
        let rank = match (info.rank, info.depth_rank) {
            (Some(r), Some(d)) => format!("rank      {r} per channel, {d} of the depth\n"),
            _ => String::new(),
        };
        let depth = info.depth_mm.map_or("none".into(), |[near, far]| format!("{near:.1} to {far:.1} mm"));
        format!(
            "table     {}: {} × {} pixels × {} positions × ({} channels + depth)\n{rank}depth     {depth}\n\
             missing   {:.1} % of the samples\nfile      {:.1} MB",
            info.kind,
            info.width,
            info.height,
            info.positions,
            info.channels,
            100.0 * info.missing,
            info.bytes as f64 / 1e6
        )
    })
}
