//! Order statistics of small and large samples, and the normal distribution.
//!
//! All order statistics select instead of sorting, so they take linear time. Values are ordered by `total_cmp`: NaN
//! comes last, and no input makes a function panic except where it says so.

use std::cmp::Ordering;

/// A floating-point number with a total order: `f32` or `f64`.
pub trait TotalOrder: Copy {
    /// Compares two numbers; NaN is greater than all others.
    fn total_order(&self, other: &Self) -> Ordering;
}

impl TotalOrder for f32 {
    fn total_order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl TotalOrder for f64 {
    fn total_order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

/// Returns the value that would stand at `index` if the values were sorted. The values are reordered.
///
/// # Panics
///
/// If there is no such index.
pub fn order_statistic<T: TotalOrder>(values: &mut [T], index: usize) -> T {
    *values.select_nth_unstable_by(index, T::total_order).1
}

/// Returns the middle value of a sample, of an even number the upper of the two middle ones; `None` for an empty
/// sample. The values are reordered.
///
/// This is the median of all robust estimates here: a value of the sample, not a mean of two.
pub fn median<T: TotalOrder>(values: &mut [T]) -> Option<T> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| order_statistic(values, middle))
}

/// Returns the `p`-th percentile (0 to 100), interpolated linearly between the two nearest values as NumPy does by
/// default; NaN for an empty sample. The values are reordered.
///
/// # Panics
///
/// If `p` is not between 0 and 100.
pub fn percentile(values: &mut [f64], p: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
    let at = p / 100.0 * last as f64;
    let (_, &mut below, rest) = values.select_nth_unstable_by(at.floor() as usize, f64::total_cmp);
    let above = rest.iter().copied().min_by(f64::total_cmp).unwrap_or(below);
    below + (above - below) * at.fract()
}

/// Returns the part of normally distributed errors that lie within `n` standard deviations: erf(n/√2), by Abramowitz and
/// Stegun 7.1.26 (to 1.5e-7). `n` is not negative.
pub fn within_sigmas(n: f64) -> f64 {
    let x = n / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let poly =
        t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    1.0 - poly * (-x * x).exp()
}
