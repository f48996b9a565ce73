//! The whole measurement, as a table and as JSON.

use super::{Machine, SurfaceBench, best_secs, kernels, steps};
use cpu_time::ProcessTime;
use serde::Serialize;
use std::fmt;
use std::time::Instant;

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The filter leaves nothing.
    #[error("no kernel and no training step has \"{0}\" in its name; leave it away to see all names")]
    Nothing(String),
    /// Asked to stop.
    #[error("stopped")]
    Cancelled,
    /// The system refused.
    #[error("cannot start {0} threads: {1}")]
    Threads(usize, String),
}

/// A kernel, measured.
#[derive(Clone, Debug, Serialize)]
pub struct KernelResult {
    /// Name and size of the workload.
    pub name: String,
    /// Points (samples, rows) per processor second.
    pub points_per_cpu_sec: f64,
    /// What one point asks of the machine: floating-point operations,
    pub flops_per_point: f64,
    /// bytes from and to main memory in order,
    pub bytes_per_point: f64,
    /// accesses at random,
    pub accesses_per_point: f64,
    /// and the cache lines they need.
    pub lines_per_point: f64,
    /// Which resource limits it.
    pub bound: String,
    /// The least possible time over the time taken, 0..1.
    pub share_of_ceiling: f64,
}

/// A training step, measured.
#[derive(Clone, Debug, Serialize)]
pub struct StepResult {
    /// Name of the workload.
    pub name: String,
    /// Threads.
    pub threads: usize,
    /// Points of one step.
    pub n_points: usize,
    /// Points per processor second of all threads together.
    pub points_per_cpu_sec: f64,
    /// Points per second of the clock on the wall.
    pub points_per_sec: f64,
    /// Sum of the phases' least possible times over the processor time taken, 0..1.
    pub share_of_ceiling: f64,
    /// The least possible time of every phase, in nanoseconds per point: (phase, ns, what limits it).
    pub phases: Vec<(String, f64, String)>,
    /// Time taken, in nanoseconds per point.
    pub ns_per_point: f64,
}

/// Ceilings, kernels and steps of one run.
#[derive(Clone, Debug, Serialize)]
pub struct BenchReport {
    /// What the machine can do.
    pub machine: Machine,
    /// Every kernel, on one thread.
    pub kernels: Vec<KernelResult>,
    /// Every training step, on each number of threads.
    pub steps: Vec<StepResult>,
}

impl BenchReport {
    /// Measures everything whose name contains `filter`, for about `budget_secs` of processor time each. Between them,
    /// `tick(done, total)` hears how far it is and `cancelled` is asked whether to go on.
    ///
    /// # Errors
    /// A [`BenchError`] if nothing has such a name, it was cancelled, or threads cannot be started.
    pub fn measure(
        filter: &str,
        threads: &[usize],
        budget_secs: f64,
        tick: &dyn Fn(usize, usize),
        cancelled: &dyn Fn() -> bool,
    ) -> Result<Self, BenchError> {
        let pool = |n| {
            rayon::ThreadPoolBuilder::new().num_threads(n).build().map_err(|e| BenchError::Threads(n, e.to_string()))
        };
        let one = pool(1)?;
        let cases: Vec<_> = kernels().into_iter().filter(|case| case.name.contains(filter)).collect();
        let shapes: Vec<_> = steps().into_iter().filter(|s| format!("step {}", s.name).contains(filter)).collect();
        if cases.is_empty() && shapes.is_empty() {
            return Err(BenchError::Nothing(filter.into()));
        }
        let total = 1 + cases.len() + shapes.len() * threads.len();
        let mut done = 0;
        let mut go_on = || {
            tick(done, total);
            done += 1;
            if cancelled() { Err(BenchError::Cancelled) } else { Ok(()) }
        };
        go_on()?;
        let machine = Machine::measure(4.0 * budget_secs);
        let mut results = Vec::new();
        for mut case in cases {
            go_on()?;
            let secs = best_secs(budget_secs, &mut case.run);
            let per_point = |total: f64| total / case.points as f64;
            let random = || case.demand.reads.iter().chain(&case.demand.updates);
            let (bound, floor) = case.demand.floor(&machine);
            results.push(KernelResult {
                points_per_cpu_sec: case.points as f64 / secs,
                flops_per_point: per_point(case.demand.flops),
                bytes_per_point: per_point(case.demand.bytes),
                accesses_per_point: per_point(random().map(|a| a.n).sum::<f64>() + 0.0),
                lines_per_point: per_point(random().map(|a| a.lines).sum::<f64>() + 0.0),
                bound: bound.into(),
                share_of_ceiling: floor / secs,
                name: case.name,
            });
        }
        let mut step_results = Vec::new();
        for shape in shapes {
            for &n_threads in threads {
                go_on()?;
                let pool = pool(n_threads)?;
                let mut bench = one.install(|| SurfaceBench::new(&shape));
                let (cpu_secs, secs) = pool.install(|| time_steps(&mut bench, budget_secs));
                let n_points = shape.n_points();
                let ns = |secs: f64| 1e9 * secs / n_points as f64;
                let demands = bench.demands();
                let floor: f64 = demands.iter().map(|(_, demand)| demand.floor(&machine).1).sum();
                let phase = |(name, demand): (&'static str, super::Demand)| {
                    let (bound, secs) = demand.floor(&machine);
                    (name.into(), ns(secs), bound.into())
                };
                step_results.push(StepResult {
                    name: shape.name.into(),
                    threads: n_threads,
                    n_points,
                    points_per_cpu_sec: n_points as f64 / cpu_secs,
                    points_per_sec: n_points as f64 / secs,
                    share_of_ceiling: floor / cpu_secs,
                    phases: demands.into_iter().map(phase).collect(),
                    ns_per_point: ns(cpu_secs),
                });
            }
        }
        Ok(Self { machine, kernels: results, steps: step_results })
    }
}

/// Returns the processor and wall seconds of a step, the best of several turns of a few steps each.
fn time_steps(bench: &mut SurfaceBench, budget_secs: f64) -> (f64, f64) {
    const TURN: usize = 4;
    // The optimizer's memory is made, and pages are touched, by the first steps.
    for _ in 0..TURN {
        bench.step();
    }
    let start = Instant::now();
    let (mut best_cpu, mut best_wall) = (f64::INFINITY, f64::INFINITY);
    let mut n_turns = 0;
    while n_turns < 3 || start.elapsed().as_secs_f64() < 2.0 * budget_secs {
        let (cpu, wall) = (ProcessTime::now(), Instant::now());
        for _ in 0..TURN {
            bench.step();
        }
        best_cpu = best_cpu.min(cpu.elapsed().as_secs_f64() / TURN as f64);
        best_wall = best_wall.min(wall.elapsed().as_secs_f64() / TURN as f64);
        n_turns += 1;
    }
    (best_cpu, best_wall)
}

impl fmt::Display for BenchReport {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let m = &self.machine;
        writeln!(f, "Machine, one core ({})", m.simd)?;
        writeln!(f, "  fused multiply-add   {:8.1} GFLOP/s", m.flops_per_sec * 1e-9)?;
        writeln!(f, "  memory in order      {:8.1} GB/s", m.bytes_per_sec * 1e-9)?;
        writeln!(f, "  exp, double          {:8.1} M/s", m.exponentials_per_sec * 1e-6)?;
        for (what, rates) in [("read", &m.reads), ("update", &m.updates)] {
            for rate in rates {
                let size = match rate.table_bytes {
                    bytes if bytes < 1 << 20 => format!("{} KiB", bytes >> 10),
                    bytes => format!("{} MiB", bytes >> 20),
                };
                writeln!(f, "  random {what:6} {size:>8} {:6.0} M lines/s", rate.lines_per_sec * 1e-6)?;
            }
        }
        if !self.kernels.is_empty() {
            writeln!(f, "\nKernels, one thread")?;
            writeln!(
                f,
                "  {:44} {:>11} {:>8} {:>8} {:>8} {:>8}  {:14} {:>7}",
                "", "M points/s", "flop/pt", "bytes/pt", "acc./pt", "lines/pt", "limit", "reached"
            )?;
        }
        for k in &self.kernels {
            writeln!(
                f,
                "  {:44} {:11.2} {:8.0} {:8.0} {:8.0} {:8.1}  {:14} {:6.0}%",
                k.name,
                k.points_per_cpu_sec * 1e-6,
                k.flops_per_point,
                k.bytes_per_point,
                k.accesses_per_point,
                k.lines_per_point,
                k.bound,
                100.0 * k.share_of_ceiling
            )?;
        }
        if !self.steps.is_empty() {
            writeln!(f, "\nTraining steps")?;
        }
        for s in &self.steps {
            writeln!(
                f,
                "  {:14} {} thread{}: {:.3} M points per CPU second, {:.3} M points/s, \
                 {:.0} ns a point, {:.0}% of the ceiling",
                s.name,
                s.threads,
                if s.threads == 1 { " " } else { "s" },
                s.points_per_cpu_sec * 1e-6,
                s.points_per_sec * 1e-6,
                s.ns_per_point,
                100.0 * s.share_of_ceiling
            )?;
            let phases: Vec<String> =
                s.phases.iter().map(|(name, ns, bound)| format!("{name} {ns:.0} ({bound})")).collect();
            writeln!(f, "      least, ns a point: {}", phases.join(", "))?;
        }
        Ok(())
    }
}
