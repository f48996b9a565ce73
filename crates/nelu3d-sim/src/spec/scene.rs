//! Scenes: closed-form objects and their colors.

use serde::{Deserialize, Serialize};

/// A static scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSpec {
    /// Its folder's name under scenes/.
    pub name: String,
    /// Whether it has a black.png.
    #[serde(default = "yes")]
    pub black: bool,
    /// What is in it.
    pub objects: Vec<ObjectSpec>,
}

fn yes() -> bool {
    true
}

/// A shape in its place, with its color.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectSpec {
    /// Where its origin is in the camera's frame, mm.
    pub position_mm: [f64; 3],
    /// Its rotation, a Rodrigues vector, object to camera.
    #[serde(default)]
    pub rotation: [f64; 3],
    /// Its form.
    pub shape: ShapeSpec,
    /// Its color.
    #[serde(default)]
    pub albedo: AlbedoSpec,
}

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
}

/// A diffuse surface's color: how much of the red, green and blue light it reflects. A mono camera sees the mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum AlbedoSpec {
    /// The same everywhere.
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
}

impl Default for AlbedoSpec {
    fn default() -> Self {
        AlbedoSpec::Constant { rgb: [0.75; 3] }
    }
}
