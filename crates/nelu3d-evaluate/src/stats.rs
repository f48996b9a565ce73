//! Statistics of signed errors.

use nelu3d_scan::statistics::percentile;

/// Statistics of signed errors (result − ground truth), in the unit of the errors; NaN when there are none.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ErrorStatistics {
    /// Mean absolute error.
    pub mae: f64,
    /// Median absolute error.
    pub median: f64,
    /// Root of the mean squared error.
    pub rmse: f64,
    /// 95th percentile of the absolute error.
    pub p95: f64,
    /// Mean signed error.
    pub bias: f64,
}

impl ErrorStatistics {
    /// Computes the statistics of finite signed errors.
    pub fn of(errors: Vec<f64>) -> Self {
        let n = errors.len() as f64;
        let mean = |f: &dyn Fn(f64) -> f64| errors.iter().map(|&e| f(e)).sum::<f64>() / n;
        let (mae, bias, rmse) = (mean(&f64::abs), mean(&|e| e), mean(&|e| e * e).sqrt());
        let mut magnitudes: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
        Self { mae, median: percentile(&mut magnitudes, 50.0), rmse, p95: percentile(&mut magnitudes, 95.0), bias }
    }
}

/// Returns `a / b`; NaN when `b` is zero.
pub(crate) fn ratio(a: usize, b: usize) -> f64 {
    if b == 0 { f64::NAN } else { a as f64 / b as f64 }
}
