//! `nelu3d evaluate`: how good a result is.

mod cad;
mod folder;
mod ground_truth;
mod result;

use anyhow::Result;
use nelu3d::result::SavedResult;

use crate::args::EvaluateArgs;
use crate::context::CommandContext;

/// Runs the command.
pub(crate) fn run(args: EvaluateArgs, context: &CommandContext) -> Result<()> {
    let result = SavedResult::read(&args.result)?;
    match (&args.truth, &args.against, &args.cad) {
        (Some(dir), ..) => ground_truth::run(&args, dir, &result, context)?,
        (None, Some(other), _) => result::run(&args, other, &result, context)?,
        (None, None, Some(mesh)) => cad::run(&args, mesh, &result, context)?,
        (None, None, None) => unreachable!("clap requires one of the three"),
    }
    Ok(())
}
