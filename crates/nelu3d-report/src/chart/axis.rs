//! Axes: which values are shown, and what is written at them.

use crate::html::escape;
use crate::number::short;

/// How a quantity runs along an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AxisScale {
    /// Evenly.
    #[default]
    Linear,
    /// By factors; only positive values are shown.
    Log,
}

/// An axis of a chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChartAxis {
    /// Quantity that it shows, with the unit.
    pub label: String,
    /// How the quantity runs along it.
    pub scale: AxisScale,
    /// Names of the positions 0, 1, 2 … instead of numbers; empty for numbers.
    pub names: Vec<String>,
    /// Whether a linear axis shows zero, whatever the values.
    pub from_zero: bool,
}

impl ChartAxis {
    /// Creates a linear axis.
    pub fn linear(label: &str) -> Self {
        Self { label: label.to_owned(), ..Self::default() }
    }

    /// Creates an axis that is logarithmic if the values are positive and span more than a factor of `over`.
    pub fn log_if_wide(label: &str, values: impl Iterator<Item = f64>, over: f64) -> Self {
        let (low, high) =
            values.filter(|v| v.is_finite()).fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
        let scale = if low > 0.0 && high > over * low { AxisScale::Log } else { AxisScale::Linear };
        Self { label: label.to_owned(), scale, ..Self::default() }
    }

    /// Returns the position of a value.
    pub(super) fn at(&self, v: f64) -> f64 {
        if self.scale == AxisScale::Log { v.log10() } else { v }
    }

    /// Returns the values to label between two positions: 1, 2 or 5 times a power of ten.
    pub(super) fn ticks(&self, [low, high]: [f64; 2]) -> Vec<f64> {
        let span = high - low;
        if !self.names.is_empty() {
            return (0..self.names.len()).map(|i| i as f64).collect();
        }
        if self.scale == AxisScale::Log {
            let decades = (low.floor() as i32..=high.ceil() as i32).map(|e| 10f64.powi(e));
            let steps: &[f64] = if span > 2.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
            return decades
                .flat_map(|d| steps.iter().map(move |s| s * d))
                .filter(|v| (low..=high).contains(&v.log10()))
                .collect();
        }
        let raw = span / 5.0;
        let power = 10f64.powf(raw.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&s| s >= raw * 0.999).unwrap_or(raw);
        let first = (low / step - 1e-9).ceil() as i64;
        let last = (high / step + 1e-9).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }

    /// Returns the range of positions that is shown, for values at these; wider by a twentieth if `wider`.
    pub(super) fn limits(&self, values: impl Iterator<Item = f64>, wider: bool) -> [f64; 2] {
        if !self.names.is_empty() {
            return [-0.5, self.names.len() as f64 - 0.5];
        }
        let [low, high] = limits(values.filter(|v| v.is_finite()), wider);
        if !self.from_zero || self.scale == AxisScale::Log {
            return [low, high];
        }
        // What lies at zero but for the widening begins there.
        let span = high - low;
        [if low < -0.06 * span { low } else { 0.0 }, high.max(0.0)]
    }

    /// Returns what is written at a value of [`ChartAxis::ticks`].
    pub(super) fn tick(&self, v: f64) -> String {
        self.names.get(v as usize).map_or_else(|| tick(v), |name| escape(name))
    }
}

/// Returns the smallest interval around all values, never empty; a twentieth wider on both sides if `wider`.
fn limits(values: impl Iterator<Item = f64>, wider: bool) -> [f64; 2] {
    let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
    let span = high - low;
    match (span > 0.0, wider) {
        (false, _) => [low - 0.5, high + 0.5],
        (true, false) => [low, high],
        (true, true) => [low - 0.05 * span, high + 0.05 * span],
    }
}

/// Returns a label, without zeros that say nothing.
fn tick(v: f64) -> String {
    let text = short(v);
    match text.split_once('e') {
        None if text.contains('.') => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let linear = ChartAxis::linear("x");
        assert_eq!(linear.ticks([0.0, 10.0]), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(linear.ticks([-0.5, 0.5]).len(), 5);
        let log = ChartAxis::log_if_wide("x", [0.01, 100.0].into_iter(), 30.0);
        assert_eq!(log.scale, AxisScale::Log);
        assert_eq!(log.ticks([-2.0, 2.0]), [0.01, 0.1, 1.0, 10.0, 100.0]);
        assert_eq!(ChartAxis::log_if_wide("x", [0.0, 100.0].into_iter(), 30.0).scale, AxisScale::Linear);
    }

    #[test]
    fn an_axis_from_zero_shows_zero() {
        let zero = ChartAxis { from_zero: true, ..ChartAxis::linear("") };
        assert_eq!(zero.limits([1.0, 3.0].into_iter(), false), [0.0, 3.0]);
        assert_eq!(zero.limits([-2.0, 3.0].into_iter(), false), [-2.0, 3.0]);
    }
}
