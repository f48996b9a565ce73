//! `nelu3d simulate`: the rig folder of a virtual scanner.

use std::path::Path;
use std::process::ExitCode;

use anyhow::Result;

use super::{Context, shown};
use crate::args;

/// Runs the command.
pub(crate) fn run(args: args::Simulate, context: &Context) -> Result<ExitCode> {
    let spec = nelu3d_sim::Spec::named(&args.spec)?;
    write(&spec, &args.output, context)?;
    context.answer(&serde_json::json!({ "rig": args.output }), || format!("rig  {}", shown(&args.output)))?;
    Ok(ExitCode::SUCCESS)
}

/// Simulates `spec` into the rig folder `output`.
pub(crate) fn write(spec: &nelu3d_sim::Spec, output: &Path, context: &Context) -> Result<()> {
    context.progress.stage("simulate the scanner");
    Ok(nelu3d_sim::simulate(spec, output, |done, total| context.progress.tick(done, total))?)
}
