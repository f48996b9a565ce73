//! `nelu3d simulate`: the rig folder of a virtual scanner.

use std::path::Path;
use std::sync::Mutex;

use anyhow::{Result, anyhow};
use nelu3d_sim::Spec;
use nelu3d_sim::spec::PRESETS;

use crate::args::SimulateArgs;
use crate::context::CommandContext;
use crate::paths::shown;

/// Runs the command.
pub(crate) fn run(args: SimulateArgs, context: &CommandContext) -> Result<()> {
    let spec = spec(&args.spec)?;
    write(&spec, &args.output, context)?;
    context.answer(&serde_json::json!({ "rig": shown(&args.output) }), || format!("rig  {}", shown(&args.output)))?;
    Ok(())
}

/// Returns a preset by its name, or the spec in a file.
fn spec(name: &str) -> Result<Spec> {
    if let Some(spec) = Spec::preset(name) {
        return Ok(spec);
    }
    let path = Path::new(name);
    if !path.exists() {
        let known = PRESETS.map(|(name, _)| name).join(", ");
        return Err(anyhow!("`{name}` is neither a preset ({known}) nor a file; name one of them"));
    }
    Ok(Spec::read(path)?)
}

/// Simulates `spec` into the rig folder `output`.
pub(crate) fn write(spec: &Spec, output: &Path, context: &CommandContext) -> Result<()> {
    let progress = &context.progress;
    let stage = Mutex::new(String::new());
    let report = |name: &str, done, total| {
        let mut stage = stage.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if *stage != name {
            name.clone_into(&mut stage);
            progress.stage(name);
        }
        progress.tick(done, total);
    };
    nelu3d_sim::simulate_until(spec, output, &report, &|| progress.cancelled())?;
    Ok(())
}
