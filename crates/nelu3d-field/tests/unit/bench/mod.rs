mod machine;

use nelu3d_field::bench::{BenchError, BenchReport, LineCounts, RaySet, steps};
use nelu3d_field::encoding::hash_grid::HashGrid;

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
    assert!(matches!(BenchReport::measure("no such", &[1], 0.0, &|_, _| (), &|| false), Err(BenchError::Nothing(_))));
    assert!(matches!(BenchReport::measure("", &[1], 0.0, &|_, _| (), &|| true), Err(BenchError::Cancelled)));
}

#[test]
fn lines_and_accesses_are_counted() {
    // At most eight lines a point and level, at least one, and never more than there are.
    let [full, ..] = steps();
    let grid = HashGrid::new(&full.config().field.encoding).unwrap();
    let rays = RaySet::new(20, 16, 0.02, 1);
    let n = rays.points().len() as f64;
    let lines = LineCounts::of(&grid, rays.points());
    for ((by_point, distinct), level) in lines.by_point.iter().zip(&lines.distinct).zip(grid.levels()) {
        assert!(n <= *by_point && *by_point <= 8.0 * n && distinct <= by_point);
        assert!(*distinct <= (level.n_entries / 8) as f64);
    }
}
