//! `nelu3d demo`: the whole path on a virtual scanner, with no input and no hardware.

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use nelu3d::result::ExtraFiles;
use nelu3d::{CalibrationOptions, ReconstructionOptions};
use nelu3d_scan::Rig;

use super::calibrate::calibrate_to;
use super::job::{ResultJob, ResultMethod, WrittenResult};
use crate::args::DemoArgs;
use crate::context::CommandContext;
use crate::paths::{default_field, default_result, shown};

/// File that marks a folder as an earlier demo's, whose rig may be replaced.
const MARKER: &str = "nelu3d-demo.txt";

/// Runs the command.
pub(crate) fn run(args: DemoArgs, context: &CommandContext) -> Result<()> {
    let spec = nelu3d_sim::Spec::preset("demo").context("the preset `demo` is part of the simulator")?;
    context.open_device(args.device)?;
    claim(&args.output)?;
    let rig_dir = args.output.join("rig");
    super::simulate::write(&spec, &rig_dir, context)?;

    let rig = Rig::open(&rig_dir)?;
    let set = rig.pattern_set(None)?;
    let field = default_field(&rig, &set.name);
    let options = CalibrationOptions { device: args.device, ..Default::default() };
    calibrate_to(&rig, set, &options, &field, context)?;
    let mut answers = Vec::new();
    for shot in rig.scenes()? {
        let job = ResultJob {
            rig: &rig,
            set,
            output: default_result(&rig, &shot.name, &set.name),
            ground_truth: Some(shot.dir.join("truth")),
            shot,
            extra: ExtraFiles::default(),
            accept: false,
            method: ResultMethod::Reconstruct {
                field: field.clone(),
                options: ReconstructionOptions { device: args.device, ..Default::default() },
                trace: true,
                correct: false,
            },
        };
        let written = job.run(context)?;
        if !written.written {
            bail!("{}", crate::verdict::refusal(&written.summary.judgment, &shown(&job.output)));
        }
        answers.push((job.output, written));
    }

    let json: Vec<_> = answers
        .iter()
        .map(|(result, WrittenResult { summary, .. })| {
            serde_json::json!({ "result": shown(result), "report": shown(&result.join("report.html")), "summary": summary })
        })
        .collect();
    context.answer(&serde_json::json!({ "rig": shown(&rig_dir), "results": json }), || {
        let mut text = String::new();
        for (result, WrittenResult { summary, metrics, .. }) in &answers {
            let metrics = metrics.as_ref().map(ToString::to_string).unwrap_or_default();
            text += &format!(
                "{}: {} points in {:.1} s\n\n{metrics}\nopen  {}\n",
                summary.scene,
                summary.pixels.valid,
                summary.wall_secs,
                shown(&result.join("report.html"))
            );
        }
        text
    })?;
    Ok(())
}

/// Makes sure that `dir` is new, empty, or an earlier demo's, so that everything in it may be replaced, and marks it.
fn claim(dir: &Path) -> Result<()> {
    std::fs::create_dir_all(dir).with_context(|| format!("{}: cannot be created", shown(dir)))?;
    let marker = dir.join(MARKER);
    let mut entries = std::fs::read_dir(dir).with_context(|| format!("{}: cannot be read", shown(dir)))?;
    if !marker.is_file() && entries.next().is_some() {
        bail!("{}: the folder holds something else; choose a new one with -o DIR", shown(dir));
    }
    std::fs::write(&marker, "Written by `nelu3d demo`, which replaces what is here when it runs again.\n")
        .with_context(|| format!("{}: cannot be written", shown(&marker)))
}
