//! Values of keys that a spec file leaves out, where several sections share them.

use super::axis::AxisSpec;

pub(super) fn yes() -> bool {
    true
}

pub(super) fn one() -> f64 {
    1.0
}

/// Whether a number is its default and is not written.
pub(super) fn is_zero(v: &f64) -> bool {
    *v == 0.0
}

pub(super) fn one_hand() -> usize {
    1
}

pub(super) fn thumb_mm() -> f64 {
    45.0
}

/// Returns the linear albedo of light skin.
pub(super) fn skin() -> [f64; 3] {
    [0.55, 0.36, 0.28]
}

pub(super) fn y_axis() -> AxisSpec {
    AxisSpec::Y
}

/// Returns the identity matrix of color mixing: every channel is a band of its own.
pub(super) fn identity() -> [[f64; 3]; 3] {
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
}
