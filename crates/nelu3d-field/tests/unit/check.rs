//! Central differences for the reference tests, and seeded inputs.

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Returns `n` uniform values in `lo..hi`.
pub(crate) fn uniform(seed: u64, n: usize, lo: f64, hi: f64) -> Vec<f64> {
    let mut rng = StdRng::seed_from_u64(seed);
    (0..n).map(|_| rng.random_range(lo..hi)).collect()
}

/// Returns the same in `f32`.
pub(crate) fn uniform_f32(seed: u64, n: usize, lo: f64, hi: f64) -> Vec<f32> {
    uniform(seed, n, lo, hi).into_iter().map(|x| x as f32).collect()
}

/// Asserts that `gradient` is that of `f` at `x`: relative error (L2 over all entries) of a fourth-order central
/// difference with step `h` at most 1e-6.
#[track_caller]
pub(crate) fn assert_gradient(x: &[f64], gradient: &[f64], h: f64, mut f: impl FnMut(&[f64]) -> f64) {
    assert_eq!(x.len(), gradient.len());
    let mut at = x.to_vec();
    let (mut error, mut norm) = (0.0, 0.0);
    for i in 0..x.len() {
        let mut value = |step: f64| {
            at[i] = x[i] + step;
            let y = f(&at);
            at[i] = x[i];
            y
        };
        let numeric = (8.0 * (value(h) - value(-h)) - (value(2.0 * h) - value(-2.0 * h))) / (12.0 * h);
        error += (numeric - gradient[i]).powi(2);
        norm += numeric.powi(2);
    }
    assert!(norm > 0.0, "a gradient of zero tests nothing");
    let relative = (error / norm).sqrt();
    assert!(relative <= 1e-6, "relative gradient error {relative:e}");
}

/// Asserts |a − b| ≤ tolerance · max(1, largest |b|) for all entries.
#[track_caller]
pub(crate) fn assert_close(a: &[f32], b: &[f32], tolerance: f32) {
    assert_eq!(a.len(), b.len());
    let scale = b.iter().fold(1.0f32, |s, x| s.max(x.abs()));
    for (i, (x, y)) in a.iter().zip(b).enumerate() {
        assert!((x - y).abs() <= tolerance * scale, "entry {i}: {x} against {y}, tolerance {}", tolerance * scale);
    }
}
