//! Shapes of objects, in the object's own frame.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::defaults::one;

/// A form, in the object's own frame: x right, y down, z away from the camera (before its rotation).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum ShapeSpec {
    /// A rectangle in z = 0 about the origin, seen from both sides.
    Plane {
        /// Side along x, mm.
        width_mm: f64,
        /// Side along y, mm.
        height_mm: f64,
    },
    /// A ball about the origin.
    Sphere {
        /// Its radius, mm.
        radius_mm: f64,
    },
    /// Two rectangles side by side, joined by a wall: z = 0 for x < 0, z = `jump_mm` for x > 0.
    Step {
        /// Side along x, mm, both halves together.
        width_mm: f64,
        /// Side along y, mm.
        height_mm: f64,
        /// Depth of the right half behind the left, mm; may be negative.
        jump_mm: f64,
    },
    /// A solid of revolution about the y axis, closed by discs. Its foot stands at the origin and it grows toward −y.
    Vase {
        /// `[height, radius]` pairs, mm, by rising height. The squared radius is the natural cubic spline through them.
        profile_mm: Vec<[f64; 2]>,
    },
    /// A box about the origin, seen from outside and inside.
    Box {
        /// Its sides along x, y and z, mm.
        size_mm: [f64; 3],
    },
    /// A cylinder about the y axis, its middle at the origin, closed by discs.
    Cylinder {
        /// Its radius, mm.
        radius_mm: f64,
        /// Its length along y, mm.
        height_mm: f64,
    },
    /// A ring about the y axis, its middle at the origin.
    Torus {
        /// From the axis to the middle of the ring's section, mm.
        major_mm: f64,
        /// Radius of the section, mm; smaller than `major_mm`.
        minor_mm: f64,
    },
    /// Triangles of a file. Where it has vertex normals, light sees the smooth surface they describe.
    Mesh {
        /// A `.ply`, `.obj`, `.stl` or `.glb` file; in a spec's file, relative to that file. A `.glb`'s meters and y up
        /// become millimeters and y down.
        #[serde(serialize_with = "nelu3d_scan::path_text::serialize")]
        file: PathBuf,
        /// Millimeters per unit of the file (of a `.glb`: per millimeter).
        #[serde(default = "one")]
        scale: f64,
    },
}
