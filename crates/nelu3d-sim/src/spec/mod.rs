//! What to simulate, declared: one value (or TOML file) that says everything about a virtual scanner and its scenes.

mod board;
mod camera;
mod check;
mod light;
mod preset;
mod scene;
mod sequence;
mod sweep;

pub use board::BoardSpec;
pub use camera::{CameraSpec, PerColor};
pub use check::SpecError;
pub use light::{BlackImage, FilmSpec, LightSpec, ProjectorSpec};
pub use preset::PRESETS;
pub use scene::{
    AlbedoSpec, AxisSpec, DeformationSpec, InterreflectionSpec, MaterialSpec, ObjectSpec, SceneSpec, ShapeSpec,
};
pub use sequence::{MotionSpec, MovingObjectSpec, SequenceSpec};
pub use sweep::SweepSpec;

use std::path::Path;

use nelu3d_scan::pattern::Pattern;
use serde::{Deserialize, Serialize};

/// A virtual scanner and everything it captures. Lengths in mm, angles in radians, the camera's frame is the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Free text, the rig's name.
    pub name: String,
    /// Seed of everything random: noise, pixel sampling, jitter of the sweep. The same seed gives the same bytes.
    #[serde(default)]
    pub seed: u64,
    /// Rays per pixel are the square of this; 1 to 16.
    #[serde(default = "supersampling")]
    pub supersampling: usize,
    /// Irradiance of the light that does not come from the light source, in units of the flash's at its reference
    /// distance. It falls on every surface alike and casts no shadow.
    #[serde(default)]
    pub ambient: f64,
    /// Light between surfaces; off where it is not given.
    #[serde(default = "no_interreflection")]
    pub interreflection: InterreflectionSpec,
    /// The camera.
    pub camera: CameraSpec,
    /// The light source.
    pub light: LightSpec,
    /// What a projector shows; none for film, which has its own pattern.
    #[serde(default)]
    pub pattern_sets: Vec<PatternSetSpec>,
    /// The board of the calibration sweep.
    pub board: BoardSpec,
    /// Albedo of the board's ink and of its paper. Gray ink still shows the pattern, black ink hardly does.
    #[serde(default = "ink_and_paper")]
    pub board_albedo: [f64; 2],
    /// Resolution of the printer that made the board, dots per inch; none: edges are exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub print_dpi: Option<f64>,
    /// Where the board is put.
    pub sweep: SweepSpec,
    /// The scenes to scan.
    #[serde(default)]
    pub scenes: Vec<SceneSpec>,
    /// The moving scenes to scan.
    #[serde(default)]
    pub sequences: Vec<SequenceSpec>,
}

fn ink_and_paper() -> [f64; 2] {
    [0.04, 0.85]
}

fn no_interreflection() -> InterreflectionSpec {
    InterreflectionSpec::OFF
}

fn supersampling() -> usize {
    4
}

/// A pattern set of the rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PatternSetSpec {
    /// Its name.
    pub name: String,
    /// Its patterns. Images are numbered by family through all sets; equal images are captured once and shared.
    pub patterns: Vec<Pattern>,
}

impl Spec {
    /// A spec that comes with the program, by its name (see [`PRESETS`]).
    pub fn preset(name: &str) -> Option<Self> {
        preset::preset(name)
    }

    /// Reads a TOML file and checks its values. Files that it names are looked for from its folder, and are read.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is not TOML, has an unknown key, or a value that makes no sense; the message names the
    /// file, the key and a remedy.
    pub fn read(path: &Path) -> Result<Self, SpecError> {
        let text = std::fs::read_to_string(path).map_err(|source| SpecError::Io { path: path.into(), source })?;
        let located = |e: SpecError| SpecError::File { path: path.into(), source: Box::new(e) };
        let mut spec: Self = toml::from_str(&text)
            .map_err(|e| located(SpecError::Syntax { reason: e.to_string().trim_end().into() }))?;
        // Files lie beside the spec that names them.
        let dir = path.parent().unwrap_or(Path::new(""));
        if let LightSpec::Film(FilmSpec { image: Some(image), .. }) = &mut spec.light {
            *image = dir.join(&*image);
        }
        let moving = spec.sequences.iter_mut().flat_map(|s| &mut s.objects).map(|o| &mut o.object);
        for object in spec.scenes.iter_mut().flat_map(|s| &mut s.objects).chain(moving) {
            object.resolve(dir);
        }
        spec.check().map_err(located)?;
        Ok(spec)
    }

    /// The spec as a TOML file.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a spec is plain data with string keys")
    }
}
