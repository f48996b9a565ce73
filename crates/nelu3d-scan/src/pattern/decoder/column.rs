//! What a decoder finds at a pixel.

/// The best other column must explain the intensities worse by this much (χ²).
const MARGIN: f32 = 6.0;
/// Largest χ² per independent measurement of a column that is believed.
const MAX_MISFIT: f32 = 12.0;

/// The column that explains a pixel's intensities best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodedColumn {
    /// The column, with its fraction, px.
    pub column: f32,
    /// Standard deviation of the fraction, px.
    pub sigma: f32,
    /// How badly it explains the measurements beyond the phase it was made from: χ².
    pub misfit: f32,
    /// The χ² of the best other column of the same phase; infinite if there is no other.
    pub runner_up: f32,
    /// Number of these measurements, at least 1.
    pub measurements: usize,
}

impl DecodedColumn {
    /// Returns whether the column explains the measurements, and clearly better than any other.
    pub fn is_reliable(&self) -> bool {
        self.misfit <= MAX_MISFIT * self.measurements as f32 && self.runner_up - self.misfit >= MARGIN
    }
}

/// Keeps the best and the second best of several columns.
pub(super) struct BestTwo {
    column: f32,
    best: f32,
    second: f32,
}

impl BestTwo {
    pub(super) fn new() -> Self {
        Self { column: f32::NAN, best: f32::INFINITY, second: f32::INFINITY }
    }

    pub(super) fn add(&mut self, column: f32, cost: f32) {
        if cost < self.best {
            (self.second, self.best, self.column) = (self.best, cost, column);
        } else {
            self.second = self.second.min(cost);
        }
    }

    /// Returns the best column, its χ² and that of the second best; `None` if there was none.
    pub(super) fn found(&self) -> Option<(f32, f32, f32)> {
        (!self.column.is_nan()).then_some((self.column, self.best, self.second))
    }
}
