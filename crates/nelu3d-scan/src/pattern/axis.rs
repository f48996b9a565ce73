//! The direction along which a pattern changes.

use serde::{Deserialize, Serialize};

use crate::image::Image;

/// The direction along which a pattern changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// From column to column.
    #[default]
    X,
    /// From row to row.
    Y,
}

impl Axis {
    /// Returns the letter of the axis, as in `gray_x_00.png`.
    pub fn letter(self) -> char {
        match self {
            Axis::X => 'x',
            Axis::Y => 'y',
        }
    }

    /// Returns the side of a `width × height` image along this axis, px.
    pub fn length(self, width: usize, height: usize) -> usize {
        match self {
            Axis::X => width,
            Axis::Y => height,
        }
    }
}

/// Makes an image that changes along `axis` only: `value` of the pixel's index along it.
pub(super) fn along(axis: Axis, width: usize, height: usize, value: impl Fn(usize) -> f64) -> Image {
    let line: Vec<f32> = (0..axis.length(width, height)).map(|i| value(i).clamp(0.0, 1.0) as f32).collect();
    let data = match axis {
        Axis::X => (0..height).flat_map(|_| line.iter().copied()).collect(),
        Axis::Y => line.iter().flat_map(|&v| std::iter::repeat_n(v, width)).collect(),
    };
    Image { width, height, channels: 1, data }
}
