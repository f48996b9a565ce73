//! Albedo of surfaces.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::axis::AxisSpec;
use super::defaults::{y_axis, yes};

/// The albedo of a surface: the part of red, green and blue light that it reflects. A mono camera sees the mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum AlbedoSpec {
    /// One color everywhere.
    Constant {
        /// Red, green, blue, each 0 to 1.
        rgb: [f64; 3],
    },
    /// A smooth change between two colors, by waves along the object's axes.
    Waves {
        /// One color.
        from: [f64; 3],
        /// The other.
        to: [f64; 3],
        /// Length of a wave, mm.
        period_mm: f64,
    },
    /// Cubes of two colors in turn, with a corner of four at the origin.
    Checker {
        /// One color.
        from: [f64; 3],
        /// The other.
        to: [f64; 3],
        /// Side of a cube, mm.
        size_mm: f64,
    },
    /// Rings about an axis, as of a tree, uneven by smooth noise.
    Wood {
        /// Early wood.
        from: [f64; 3],
        /// Late wood.
        to: [f64; 3],
        /// Mean width of a ring, mm.
        ring_mm: f64,
        /// The tree's axis.
        #[serde(default = "y_axis")]
        axis: AxisSpec,
        /// Seed of the noise.
        #[serde(default)]
        seed: u64,
    },
    /// A picture, projected along an axis. Its middle lies on the axis and it ends there, where its last pixels go on.
    Image {
        /// A PNG or TIFF; in a spec's file, relative to that file.
        #[serde(serialize_with = "nelu3d_scan::path_text::serialize")]
        file: PathBuf,
        /// Its width and height, mm.
        size_mm: [f64; 2],
        /// Along which axis: z puts its columns along x and its rows along y, y along x and z, x along z and y.
        #[serde(default)]
        axis: AxisSpec,
        /// Whether its codes are sRGB, as of photographs, or else proportional to the albedo.
        #[serde(default = "yes")]
        srgb: bool,
    },
    /// The colors of a mesh's vertices, between them linear.
    #[serde(rename = "vertex-colors")]
    VertexColors {
        /// Whether they are sRGB, or else proportional to the albedo.
        #[serde(default = "yes")]
        srgb: bool,
    },
}

impl Default for AlbedoSpec {
    fn default() -> Self {
        AlbedoSpec::Constant { rgb: [0.75; 3] }
    }
}
