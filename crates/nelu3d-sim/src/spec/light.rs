//! The light source: a projector or film.

use serde::{Deserialize, Serialize};

use super::film::FilmSpec;
use super::projector::{BlackImage, ProjectorSpec};

/// The light source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum LightSpec {
    /// A projector: pixels, a lens, a focus plane.
    Projector(ProjectorSpec),
    /// Film before one lamp and a second lamp for the flash: no pixels, no lens.
    Film(FilmSpec),
}

impl LightSpec {
    /// Returns the state of the light source in black.png.
    pub fn black(&self) -> BlackImage {
        match self {
            LightSpec::Projector(p) => p.black,
            LightSpec::Film(_) => BlackImage::Off,
        }
    }
}
