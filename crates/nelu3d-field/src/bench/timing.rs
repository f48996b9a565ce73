//! Timing of kernels, and the unit of memory traffic.

use cpu_time::ProcessTime;

/// Bytes of a cache line.
pub const LINE: usize = 64;

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
