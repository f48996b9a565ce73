//! `nelu3d bench`: what the machine can do, and how much of it the engine and recipe `fast` use.

mod fast;

use anyhow::Result;
use fast::FastReport;
use nelu3d_field::bench::{BenchReport, Machine};
use nelu3d_field::device::Device;
use serde::Serialize;

use crate::args::BenchArgs;
use crate::context::CommandContext;

/// What was measured on the CPU.
#[derive(Serialize)]
struct CpuReport {
    #[serde(flatten)]
    engine: BenchReport,
    /// Recipe `fast`, if it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    fast: Option<FastReport>,
}

/// Runs the command.
pub(crate) fn run(args: BenchArgs, context: &CommandContext) -> Result<()> {
    match Device::open(args.device)? {
        #[cfg(feature = "gpu")]
        Device::Gpu(gpu) => {
            context.progress.stage("Measuring");
            let report = nelu3d_field::gpu::GpuReport::measure(&gpu, args.samples, args.seconds)?;
            context.answer(&report, || report.to_string())?;
        }
        Device::Cpu => {
            let report = on_cpu(&args, context)?;
            context.answer(&report, || {
                report.engine.to_string() + &report.fast.as_ref().map(|f| format!("\n{f}")).unwrap_or_default()
            })?;
        }
    }
    Ok(())
}

/// Measures kernels, training steps, and recipe `fast`, as far as they are asked for.
fn on_cpu(args: &BenchArgs, context: &CommandContext) -> Result<CpuReport> {
    let mut threads = vec![1, rayon::current_num_threads()];
    threads.dedup();
    context.progress.stage("Measuring");
    let engine = if args.filter == fast::NAME {
        BenchReport { machine: Machine::measure(4.0 * args.seconds), kernels: Vec::new(), steps: Vec::new() }
    } else {
        let tick = |done, total| context.progress.tick(done, total);
        let cancelled = || context.progress.cancelled();
        BenchReport::measure(&args.filter, &threads, args.seconds, &tick, &cancelled)?
    };
    let is_asked_for = args.filter.is_empty() || args.filter == fast::NAME;
    let fast = is_asked_for.then(|| fast::measure(&engine.machine, context)).transpose()?;
    Ok(CpuReport { engine, fast })
}
