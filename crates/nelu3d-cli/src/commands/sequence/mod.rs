//! `nelu3d sequence`: a folder of frames becomes a moving surface.
//!
//! Every frame is a result folder that appears whole or not at all, so the folder itself says how far the work is:
//! after a kill, a crash or a power cut the same command goes on where it stopped, and several machines can work on
//! parts of one sequence in one shared folder without talking to each other.

mod folder;
#[cfg(feature = "capture")]
mod follow;
mod frame_table;
mod merge;
mod outputs;
mod pipeline;
mod read_ahead;
mod slurm;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use nelu3d::result::Input;
use nelu3d::sequence::Plan;
use nelu3d_scan::Rig;
use nelu3d_scan::rig::Shot;

use self::folder::SequenceFolder;
use self::pipeline::SequenceRun;
use crate::args::SequenceArgs;
use crate::context::CommandContext;
use crate::paths::{default_field, default_result, load_field, shown};

/// Runs the command.
pub(crate) fn run(args: &SequenceArgs, context: &CommandContext) -> Result<()> {
    let rig = Rig::open(&args.rig)?;
    let set = rig.pattern_set(args.set.as_deref())?;
    #[cfg(feature = "capture")]
    if args.follow && !follow::run(args, &rig, set, context)? {
        return Ok(());
    }
    let frames = rig.sequence(&args.sequence)?;
    let output = match &args.output {
        Some(output) => output.clone(),
        None => default_output(&rig, &frames, &set.name)?,
    };
    let path = args.field.clone().unwrap_or_else(|| default_field(&rig, &set.name));
    if let Some(script) = &args.slurm {
        return slurm::write(script, args, &output, frames.len(), context);
    }
    context.open_device(args.options.device)?;
    let field = load_field(&rig, set, &path)?;
    let mut inputs = Vec::new();
    for file in [rig.root.join(nelu3d_scan::rig::RIG_FILE), rig.root.join(&rig.camera_file), path] {
        inputs.push(Input::of(&file).with_context(|| format!("{}: cannot be read", shown(&file)))?);
    }
    let plan = Plan { frames: frames.len(), keyframe: args.keyframe.get() };
    let settings = serde_json::json!({
        "field": inputs[2].sha256,
        "set": set.name,
        "keyframe": args.keyframe,
        "options": args.options,
        "motion": args.motion,
    });
    let folder = SequenceFolder::open(&output, &settings)?;
    let run = SequenceRun { rig: &rig, set, frames, field, inputs, args, plan, folder };
    let failed = run.all(context)?;
    report(&run, &output, &failed, context)?;
    if !failed.is_empty() {
        let listed: Vec<String> = failed.iter().map(|(frame, why)| format!("{frame}: {why}")).collect();
        anyhow::bail!("{} of {} frames failed: {}", failed.len(), run.frames.len(), listed.join("; "));
    }
    Ok(())
}

/// Returns where the results of a sequence are written by default.
fn default_output(rig: &Rig, frames: &[Shot], set: &str) -> Result<PathBuf> {
    let dir = frames[0].dir.canonicalize().with_context(|| format!("{}: is gone", shown(&frames[0].dir)))?;
    let name = dir.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
    Ok(default_result(rig, &name, set))
}

/// Prints the answer; where all frames are done or have failed, writes what spans them first.
fn report(run: &SequenceRun<'_>, output: &Path, failed: &[(String, String)], context: &CommandContext) -> Result<()> {
    let done = run.frames.iter().filter(|f| run.folder.is_done(f)).count();
    let complete = run.frames.iter().all(|f| run.folder.is_done(f) || run.folder.failure(f).is_some());
    let mut answer = serde_json::json!({
        "sequence": shown(output), "frames": run.frames.len(), "done": done, "failed": failed, "complete": complete,
    });
    let mut text = format!("{done} of {} frames are done\n", run.frames.len());
    if complete && done > 0 {
        context.progress.stage("write the moving surface");
        let table = outputs::write(&run.folder, &run.frames, run.args.fps)?;
        answer["table"] = table.json();
        answer["mean"] = table.mean();
        let (verdict, warnings, notes) = (table.verdict(), table.codes("warnings"), table.codes("notes"));
        answer["verdict"] = verdict.into();
        answer["warnings"] = serde_json::json!(warnings);
        answer["notes"] = serde_json::json!(notes);
        let listed: Vec<String> = warnings.iter().map(|(code, n)| format!("{code} in {n}")).collect();
        let of = if listed.is_empty() { String::new() } else { format!(" ({})", listed.join(", ")) };
        text = format!("verdict   {verdict}{of}\n{text}");
        text += &format!("\n{table}");
        text += &format!("animation  {}\n", shown(&output.join(outputs::ANIMATION)));
        text += &format!("preview    {}\n", shown(&output.join(outputs::PREVIEW)));
        text += &format!("meshes     {}\n", shown(&output.join(outputs::MESHES)));
    }
    text += &format!("sequence   {}", shown(output));
    context.answer(&answer, || text)
}
