//! What this machine can do, and how close the kernels come: for `nelu3d bench` and the divan benches.
//!
//! [`Machine`] measures ceilings: fused multiply-adds, memory read in order and at random. A [`Case`] is a kernel or a
//! training step at a named size, with its [`Demand`] counted by hand: from the two follows the least time the work can
//! take here (a roofline), and the share of it that is reached.
//!
//! Everything runs on one thread unless said otherwise, and is timed in seconds of the processor, best of several:
//! other programs on the machine then disturb least.

mod kernels;
mod machine;
mod rays;
mod report;
mod steps;

pub use kernels::kernels;
pub use machine::{Machine, Rate};
pub use rays::RaySet;
pub use report::{BenchError, BenchReport, KernelResult, StepResult};
pub use steps::{StepShape, SurfaceBench, steps};

use cpu_time::ProcessTime;

/// Bytes of a cache line.
pub const LINE: usize = 64;

/// Accesses to one table at random.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Accesses {
    /// Bytes of the table, or of all that is used between two uses of a line.
    pub table_bytes: usize,
    /// Accesses.
    pub n: f64,
    /// Cache lines they need: several accesses by one point to one line need it once.
    pub lines: f64,
}

/// The demand of a piece of work on the machine.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Demand {
    /// Floating-point operations; a fused multiply-add is two.
    pub flops: f64,
    /// Bytes that come from or go to main memory in order.
    pub bytes: f64,
    /// Reading at random.
    pub reads: Vec<Accesses>,
    /// Reading and writing at random.
    pub updates: Vec<Accesses>,
    /// Exponentials in double precision.
    pub exponentials: f64,
}

impl Demand {
    /// Returns the least time of every part on a machine, s.
    fn parts(&self, machine: &Machine) -> [(&'static str, f64); 5] {
        // Every access takes a place in the processor's pipeline; every line must come from where it is.
        let random = |demand: &[Accesses], rates: &[Rate]| -> f64 {
            let near = 1.0 / rates[0].lines_per_sec;
            let secs = |a: &Accesses| {
                a.n * near + a.lines * (1.0 / machine::interpolate(rates, a.table_bytes) - near).max(0.0)
            };
            demand.iter().map(secs).sum()
        };
        [
            ("arithmetic", self.flops / machine.flops_per_sec),
            ("bandwidth", self.bytes / machine.bytes_per_sec),
            ("random reads", random(&self.reads, &machine.reads)),
            ("random updates", random(&self.updates, &machine.updates)),
            ("exponentials", self.exponentials / machine.exponentials_per_sec),
        ]
    }

    /// Returns the least time on a machine, s: its slowest part, as if everything else went on beside it; and which
    /// part that is.
    pub fn floor(&self, machine: &Machine) -> (&'static str, f64) {
        self.parts(machine).into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("five parts")
    }
}

/// A kernel at a named size.
pub struct Case {
    /// What is run, and on what.
    pub name: String,
    /// Points (samples, parameters) of one run.
    pub points: usize,
    /// What one run asks of the machine.
    pub demand: Demand,
    /// One run, on the calling thread.
    pub run: Box<dyn FnMut()>,
}

/// Returns the processor seconds of one call of `run`: the best of several repetitions that take about `budget_secs`
/// together.
pub fn best_secs(budget_secs: f64, mut run: impl FnMut()) -> f64 {
    run();
    let time = |n: usize, run: &mut dyn FnMut()| {
        let start = ProcessTime::now();
        (0..n).for_each(|_| run());
        start.elapsed().as_secs_f64() / n as f64
    };
    let once = time(1, &mut run).max(1e-9);
    // Repetitions of a millisecond at least, so that the clock's resolution does not matter; five of them at least.
    let n = (1e-3 / once).ceil().max(1.0) as usize;
    let repetitions = (budget_secs / (once * n as f64)).clamp(5.0, 1000.0) as usize;
    (0..repetitions).map(|_| time(n, &mut run)).fold(once, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_and_step_is_measured_against_its_ceiling() {
        let report = BenchReport::measure("cached", &[1, 2], 0.0, &|_, _| (), &|| false).unwrap();
        assert!(report.kernels.len() == 4 && report.steps.is_empty(), "{:?}", report.kernels);
        for kernel in &report.kernels {
            assert!(kernel.points_per_cpu_sec > 0.0 && kernel.share_of_ceiling > 1e-3, "{kernel:?}");
        }
        let steps = BenchReport::measure("step narrow-small", &[1, 2], 0.0, &|_, _| (), &|| false).unwrap().steps;
        assert_eq!(steps.iter().map(|s| s.threads).collect::<Vec<_>>(), [1, 2]);
        assert!(steps.iter().all(|s| s.n_points == 16384 && s.share_of_ceiling > 1e-3 && s.phases.len() == 5));
        assert!(matches!(
            BenchReport::measure("no such", &[1], 0.0, &|_, _| (), &|| false),
            Err(BenchError::Nothing(_))
        ));
        assert!(matches!(BenchReport::measure("", &[1], 0.0, &|_, _| (), &|| true), Err(BenchError::Cancelled)));
    }

    #[test]
    fn lines_and_accesses_are_counted() {
        // At most eight lines a point and level, at least one, and never more than there are.
        let [full, ..] = steps();
        let grid = crate::encoding::hash_grid::HashGrid::new(&full.config().field.encoding).unwrap();
        let rays = RaySet::new(20, 16, 0.02, 1);
        let n = rays.points().len() as f64;
        let lines = steps::LineCounts::of(&grid, rays.points());
        for ((by_point, distinct), level) in lines.by_point.iter().zip(&lines.distinct).zip(grid.levels()) {
            assert!(n <= *by_point && *by_point <= 8.0 * n && distinct <= by_point);
            assert!(*distinct <= (level.n_entries / 8) as f64);
        }
    }
}
