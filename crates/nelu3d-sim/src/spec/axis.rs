//! Axes of an object's frame.

use serde::{Deserialize, Serialize};

/// An axis of an object's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AxisSpec {
    /// Right.
    X,
    /// Down.
    Y,
    /// Away from the camera.
    #[default]
    Z,
}

impl AxisSpec {
    /// Returns the index of the coordinate: 0, 1 or 2.
    pub(crate) fn index(self) -> usize {
        self as usize
    }
}
