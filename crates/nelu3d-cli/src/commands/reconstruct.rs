//! `nelu3d reconstruct`: a scene becomes a result folder.

use anyhow::Result;
use nelu3d_scan::Rig;

use super::job::{ResultJob, ResultMethod, answer, extra_files};
use crate::args::ReconstructArgs;
use crate::context::CommandContext;
use crate::paths::{default_field, default_result};

/// Runs the command.
pub(crate) fn run(args: ReconstructArgs, context: &CommandContext) -> Result<()> {
    let rig = Rig::open(&args.rig)?;
    let set = rig.pattern_set(args.set.as_deref())?;
    let shot = rig.scene(&args.scene)?;
    context.open_device(args.options.device)?;
    let job = ResultJob {
        output: args.output.unwrap_or_else(|| default_result(&rig, &shot.name, &set.name)),
        ground_truth: args.truth,
        extra: extra_files(&args.mesh, &args.also),
        accept: args.accept,
        method: ResultMethod::Reconstruct {
            field: args.field.unwrap_or_else(|| default_field(&rig, &set.name)),
            options: args.options,
            trace: args.trace,
            correct: args.correct,
        },
        rig: &rig,
        shot,
        set,
    };
    answer(&job, context)?;
    Ok(())
}
