//! Values of keys that a spec file leaves out, where several sections share them.

use super::axis::AxisSpec;

pub(super) fn yes() -> bool {
    true
}

pub(super) fn one() -> f64 {
    1.0
}

pub(super) fn y_axis() -> AxisSpec {
    AxisSpec::Y
}

/// Returns the identity matrix of color mixing: every channel is a band of its own.
pub(super) fn identity() -> [[f64; 3]; 3] {
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
}
