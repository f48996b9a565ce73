//! What this machine can do, and how close the kernels come: for `nelu3d bench` and the divan benches.
//!
//! [`Machine`] measures ceilings: fused multiply-adds, memory read in order and at random. A [`Case`] is a kernel or a
//! training step at a named size, with its [`Demand`] counted by hand: from the two follows the least time the work can
//! take here (a roofline), and the share of it that is reached.
//!
//! Everything runs on one thread unless said otherwise, and is timed in seconds of the processor, best of several:
//! other programs on the machine then disturb least.

mod demand;
mod kernels;
mod machine;
mod rays;
mod report;
mod steps;
mod timing;

pub use demand::{Accesses, Case, Demand};
pub use kernels::kernels;
pub use machine::{Machine, Rate};
pub use rays::RaySet;
pub use report::{BenchError, BenchReport, KernelResult, StepResult};
pub use steps::{StepShape, SurfaceBench, steps};
pub use timing::{LINE, best_secs};

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
