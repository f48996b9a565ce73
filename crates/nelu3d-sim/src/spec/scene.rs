//! Scenes: objects, their forms, colors and materials, and how often light bounces between them.

use std::path::{Path, PathBuf};

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
    /// A smooth change of the form, in the object's frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deformation: Option<DeformationSpec>,
    /// Its color.
    #[serde(default)]
    pub albedo: AlbedoSpec,
    /// How it reflects.
    #[serde(default)]
    pub material: MaterialSpec,
}

impl ObjectSpec {
    /// Takes the files it names from `dir` where they are given relative.
    pub(crate) fn resolve(&mut self, dir: &Path) {
        let absolute = |file: &mut PathBuf| {
            let joined = dir.join(&*file);
            *file = std::path::absolute(&joined).unwrap_or(joined);
        };
        if let ShapeSpec::Mesh { file, .. } = &mut self.shape {
            absolute(file);
        }
        if let AlbedoSpec::Image { file, .. } = &mut self.albedo {
            absolute(file);
        }
    }
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
        file: PathBuf,
        /// Millimeters per unit of the file (of a `.glb`: per millimeter).
        #[serde(default = "one")]
        scale: f64,
    },
}

fn one() -> f64 {
    1.0
}

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
    /// 0, 1 or 2.
    pub(crate) fn index(self) -> usize {
        self as usize
    }
}

/// A smooth map of the object's frame that bends the object. A closed form becomes a fine mesh first, which is then what
/// is seen and what is true; a mesh of a file is bent at its vertices.
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
        /// Where it runs in the object's frame; its length does not matter.
        #[serde(default = "along_x")]
        direction: [f64; 3],
    },
    /// What is flat in z = 0 becomes a part of a cylinder whose axis is parallel to `axis` (x or y), at z = 1/curvature.
    Bend {
        /// One over the cylinder's radius, 1/mm; positive: the middle comes forward (the axis lies behind it).
        curvature_per_mm: f64,
        /// What stays straight: x or y.
        #[serde(default = "y_axis")]
        axis: AxisSpec,
    },
    /// Every section across the axis turns by its distance from the origin.
    Twist {
        /// Radians per mm.
        rate_per_mm: f64,
        /// About which axis.
        #[serde(default = "y_axis")]
        axis: AxisSpec,
    },
}

fn along_x() -> [f64; 3] {
    [1.0, 0.0, 0.0]
}

fn y_axis() -> AxisSpec {
    AxisSpec::Y
}

/// How a surface reflects light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum MaterialSpec {
    /// Alike in all directions.
    #[default]
    Lambert,
    /// Lacquer over a diffuse ground: a microfacet reflection (GGX) of uncolored light, and below it what it lets through.
    Glossy {
        /// From 0.05 (nearly a mirror) to 1 (dull). The microfacets' slope is its square.
        roughness: f64,
        /// Share of light reflected head-on, 0 to 1; 0.04 for plastic and glass.
        #[serde(default = "plastic")]
        reflectance: f64,
    },
    /// Wax, marble, skin: a share of the light leaves the surface beside where it entered. The distance between the two,
    /// along the surface, is exponentially distributed.
    Translucent {
        /// Mean of that distance, mm.
        mean_free_path_mm: f64,
        /// Share of the light that does so, 0 to 1.
        #[serde(default = "one")]
        share: f64,
    },
}

fn plastic() -> f64 {
    0.04
}

/// Light that reaches a surface by way of others, found by path tracing. Without bounces (the default) there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InterreflectionSpec {
    /// Surfaces on the way, at most, besides the one seen; 0: no interreflection.
    pub bounces: usize,
    /// Random paths per pixel, rounded up so that every ray of a pixel (`supersampling`²) has as many.
    pub paths_per_pixel: usize,
}

impl InterreflectionSpec {
    /// No interreflection.
    pub const OFF: Self = Self { bounces: 0, paths_per_pixel: 16 };

    /// Whether there is none.
    pub fn is_off(&self) -> bool {
        self.bounces == 0
    }
}

/// What an `[interreflection]` without keys means. A spec without it has [`InterreflectionSpec::OFF`].
impl Default for InterreflectionSpec {
    fn default() -> Self {
        Self { bounces: 3, paths_per_pixel: 16 }
    }
}

/// A surface's color: how much of the red, green and blue light it reflects. A mono camera sees the mean.
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
