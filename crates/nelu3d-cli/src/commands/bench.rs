//! `nelu3d bench`: what the machine can do, and how much of it the engine uses.

use std::process::ExitCode;

use anyhow::Result;
use nelu3d_field::bench::BenchReport;
use nelu3d_field::device::Device;

use crate::args::BenchArgs;
use crate::context::CommandContext;

/// Runs the command.
pub(crate) fn run(args: BenchArgs, context: &CommandContext) -> Result<ExitCode> {
    match Device::open(args.device)? {
        #[cfg(feature = "gpu")]
        Device::Gpu(gpu) => {
            context.progress.stage("Measuring");
            let report = nelu3d_field::gpu::GpuReport::measure(&gpu, args.samples, args.seconds)?;
            context.answer(&report, || report.to_string())?;
        }
        Device::Cpu => {
            let mut threads = vec![1, rayon::current_num_threads()];
            threads.dedup();
            context.progress.stage("Measuring");
            let tick = |done, total| context.progress.tick(done, total);
            let cancelled = || context.progress.cancelled();
            let report = BenchReport::measure(&args.filter, &threads, args.seconds, &tick, &cancelled)?;
            context.answer(&report, || report.to_string())?;
        }
    }
    Ok(ExitCode::SUCCESS)
}
