//! Order statistics of small and large samples.
//!
//! All of them select instead of sorting, so they take linear time. Values are ordered by `total_cmp`: NaN comes last,
//! and no input makes a function panic except where it says so.

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_a_value_of_the_sample() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0f32, 1.0, 3.0, 2.0]), Some(3.0));
        assert_eq!(median::<f64>(&mut []), None);
        assert_eq!(median(&mut [f64::NAN, 1.0, 2.0]), Some(2.0));
    }

    #[test]
    fn order_statistics_are_those_of_the_sorted_values() {
        let values: Vec<f64> = (0..50).map(|i| f64::from((i * 37) % 50)).collect();
        for index in 0..50 {
            assert_eq!(order_statistic(&mut values.clone(), index), index as f64);
        }
    }

    #[test]
    fn percentiles_are_those_of_numpy() {
        let values = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(percentile(&mut values.clone(), 50.0), 2.5);
        assert_eq!(percentile(&mut values.clone(), 0.0), 1.0);
        assert_eq!(percentile(&mut values.clone(), 100.0), 4.0);
        assert!((percentile(&mut values.clone(), 95.0) - 3.85).abs() < 1e-12);
        assert!(percentile(&mut [], 50.0).is_nan());
    }
}
