//! `nelu3d decode`: a scene becomes a result folder, with one of the baselines.

use anyhow::Result;
use nelu3d_scan::Rig;

use super::job::{ResultJob, ResultMethod, answer, extra_files};
use crate::args::DecodeArgs;
use crate::context::CommandContext;
use crate::paths::default_result;

/// Runs the command.
pub(crate) fn run(args: DecodeArgs, context: &CommandContext) -> Result<()> {
    let rig = Rig::open(&args.rig)?;
    let set = rig.pattern_set(args.set.as_deref())?;
    let shot = rig.scene(&args.scene)?;
    let job = ResultJob {
        output: args.output.unwrap_or_else(|| {
            default_result(&rig, &shot.name, &format!("{}-{}", set.name, args.options.method.name()))
        }),
        ground_truth: args.truth,
        extra: extra_files(&args.mesh, &args.also),
        accept: args.accept,
        method: ResultMethod::Decode(args.options),
        rig: &rig,
        shot,
        set,
    };
    answer(&job, context)?;
    Ok(())
}
