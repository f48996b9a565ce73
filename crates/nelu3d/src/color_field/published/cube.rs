//! The cube of form `published`.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::color_field::frame::FieldFrame;

/// A cube along the camera's axes around the volume of a field: equally fine in every direction, whatever the light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldCube {
    /// Corner of the least coordinates, in the camera's frame, mm.
    pub corner_mm: [f64; 3],
    /// Length of a side, mm.
    pub side_mm: f64,
}

impl FieldCube {
    /// Returns the smallest cube around the box of a frame, with the same center.
    pub fn around(frame: &FieldFrame) -> Self {
        // Lines stay lines in a projective frame, so its box is the hull of its corners.
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in 0..8 {
            let x = frame.from_unit([0, 1, 2].map(|a| f64::from(corner >> a & 1)));
            for a in 0..3 {
                (lo[a], hi[a]) = (lo[a].min(x[a]), hi[a].max(x[a]));
            }
        }
        let side_mm = (0..3).map(|a| hi[a] - lo[a]).fold(0.0, f64::max);
        Self { corner_mm: std::array::from_fn(|a| 0.5 * (lo[a] + hi[a] - side_mm)), side_mm }
    }

    /// Returns the coordinates of a point (camera's frame, mm) in the unit cube.
    pub fn to_unit(&self, x: &Point3<f64>) -> [f32; 3] {
        std::array::from_fn(|a| ((x[a] - self.corner_mm[a]) / self.side_mm) as f32)
    }

    /// Returns whether all its numbers are those of a cube.
    pub fn is_valid(&self) -> bool {
        self.corner_mm.iter().all(|v| v.is_finite()) && self.side_mm.is_finite() && self.side_mm > 0.0
    }
}
