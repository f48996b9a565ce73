//! `nelu3d reconstruct`: a scene becomes a result folder.

use std::process::ExitCode;

use anyhow::Result;
use nelu3d_scan::Rig;

use super::job::{Job, Work, answer, mesh_files};
use super::{Context, default_field, default_result};
use crate::args;

/// Runs the command.
pub(crate) fn run(args: args::Reconstruct, context: &Context) -> Result<ExitCode> {
    let rig = Rig::open(&args.rig)?;
    let set = rig.pattern_set(args.set.as_deref())?;
    let shot = rig.scene(&args.scene)?;
    context.open_device(args.options.device)?;
    let job = Job {
        output: args.output.unwrap_or_else(|| default_result(&rig, &shot.name, &set.name)),
        truth: args.truth,
        mesh_files: mesh_files(&args.mesh),
        work: Work::Reconstruct {
            field: args.field.unwrap_or_else(|| default_field(&rig, &set.name)),
            options: args.options,
            trace: args.trace,
        },
        rig: &rig,
        shot,
        set,
    };
    answer(&job, context)?;
    Ok(ExitCode::SUCCESS)
}
