//! `nelu3d decode`: a scene becomes a result folder, with one of the methods that NeLU3D is compared with.

use std::process::ExitCode;

use anyhow::Result;
use nelu3d_scan::Rig;

use super::job::{Job, Work, answer, mesh_files};
use super::{Context, default_result};
use crate::args;

/// Runs the command.
pub(crate) fn run(args: args::Decode, context: &Context) -> Result<ExitCode> {
    let rig = Rig::open(&args.rig)?;
    let set = rig.pattern_set(args.set.as_deref())?;
    let shot = rig.scene(&args.scene)?;
    let job = Job {
        output: args.output.unwrap_or_else(|| {
            default_result(&rig, &shot.name, &format!("{}-{}", set.name, args.options.method.name()))
        }),
        truth: args.truth,
        mesh_files: mesh_files(&args.mesh),
        work: Work::Decode(args.options),
        rig: &rig,
        shot,
        set,
    };
    answer(&job, context)?;
    Ok(ExitCode::SUCCESS)
}
