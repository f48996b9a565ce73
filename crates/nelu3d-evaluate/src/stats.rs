//! Statistics of signed errors.

/// Statistics of signed errors (ours − truth), in the unit of the errors. NaN when there are none.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Errors {
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

impl Errors {
    /// Statistics of finite signed errors.
    pub fn of(errors: Vec<f64>) -> Self {
        let n = errors.len() as f64;
        let mean = |f: &dyn Fn(f64) -> f64| errors.iter().map(|&e| f(e)).sum::<f64>() / n;
        let (mae, bias, rmse) = (mean(&f64::abs), mean(&|e| e), mean(&|e| e * e).sqrt());
        let magnitudes: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
        Self { mae, median: percentile(magnitudes.clone(), 50.0), rmse, p95: percentile(magnitudes, 95.0), bias }
    }
}

/// The `p`-th percentile (0–100), linear between the two nearest values (NumPy's default); NaN for an empty list.
pub fn percentile(mut values: Vec<f64>, p: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
    let at = p / 100.0 * last as f64;
    // Selection, not sorting: maps have up to 31 million values.
    let (_, &mut below, rest) = values.select_nth_unstable_by(at.floor() as usize, f64::total_cmp);
    let above = rest.iter().copied().min_by(f64::total_cmp).unwrap_or(below);
    below + (above - below) * at.fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_numpys() {
        let values = vec![4.0, 1.0, 3.0, 2.0];
        assert_eq!(percentile(values.clone(), 50.0), 2.5);
        assert_eq!(percentile(values.clone(), 0.0), 1.0);
        assert_eq!(percentile(values.clone(), 100.0), 4.0);
        assert!((percentile(values, 95.0) - 3.85).abs() < 1e-12);
        assert!(percentile(Vec::new(), 50.0).is_nan());
    }
}
