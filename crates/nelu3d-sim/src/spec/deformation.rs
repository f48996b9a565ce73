//! Smooth deformations of objects.

use serde::{Deserialize, Serialize};

use super::axis::AxisSpec;
use super::defaults::y_axis;

/// A smooth map of the object's frame that bends the object. A closed form becomes a fine mesh first, which is then
/// what is seen and what is true; a mesh of a file is bent at its vertices.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum DeformationSpec {
    /// A wave along a direction lifts points along z: `z + amplitude · sin(2π · direction · p / wavelength + phase)`.
    Wave {
        /// Height of the wave over the middle, mm.
        amplitude_mm: f64,
        /// Its length, mm.
        wavelength_mm: f64,
        /// Its phase at the origin, radians.
        #[serde(default)]
        phase: f64,
        /// Direction in which it runs in the object's frame; its length does not matter.
        #[serde(default = "along_x")]
        direction: [f64; 3],
    },
    /// What is flat in z = 0 becomes a part of a cylinder whose axis is parallel to `axis` (x or y), at z =
    /// 1/curvature.
    Bend {
        /// One over the cylinder's radius, 1/mm; positive: the middle comes forward (the axis lies behind it).
        curvature_per_mm: f64,
        /// Axis that stays straight: x or y.
        #[serde(default = "y_axis")]
        axis: AxisSpec,
    },
    /// What is farther than `from_mm` along a direction comes forward, along −z, by the square of how much farther.
    Curl {
        /// How far forward it is at `to_mm`, mm.
        height_mm: f64,
        /// Where it begins, mm from the origin along the direction.
        from_mm: f64,
        /// Where it is `height_mm`, mm from the origin along the direction.
        to_mm: f64,
        /// Direction in the object's frame; its length does not matter.
        #[serde(default = "along_x")]
        direction: [f64; 3],
    },
    /// Every section across the axis turns by its distance from the origin.
    Twist {
        /// Radians per mm.
        rate_per_mm: f64,
        /// Axis of the twist.
        #[serde(default = "y_axis")]
        axis: AxisSpec,
    },
}

fn along_x() -> [f64; 3] {
    [1.0, 0.0, 0.0]
}
