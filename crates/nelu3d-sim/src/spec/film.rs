//! Film projectors.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::defaults::one;

/// A color film before a small lamp, which throws the film's shadow on the scene, and a white lamp beside it.
///
/// The film's transmission is a sum of plane waves per color, whose blur by the lamp's size has a closed form, or an
/// image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilmSpec {
    /// Position of the lamp behind the film in the camera's frame, mm.
    pub position_mm: [f64; 3],
    /// The point its axis passes through, mm.
    pub target_mm: [f64; 3],
    /// Offset of the white lamp from the other, camera's frame, mm. Away from zero, white and pattern light fall
    /// differently on a surface, and their ratio is not exactly the pattern.
    #[serde(default)]
    pub flash_offset_mm: [f64; 3],
    /// Strength of the film's LED in red, green and blue.
    #[serde(default = "white")]
    pub film_led: [f64; 3],
    /// Strength of the flash's LED in red, green and blue.
    #[serde(default = "white")]
    pub flash_led: [f64; 3],
    /// Distance at which the irradiance of the flash is 1, mm.
    pub reference_mm: f64,
    /// Distance from the lamp to the film, mm.
    pub film_mm: f64,
    /// Standard deviation of the lamp's Gaussian disc, mm. It blurs the film's shadow.
    pub lamp_sigma_mm: f64,
    /// Half sides of the film, mm; no light passes beside it.
    pub film_half_size_mm: [f64; 2],
    /// Intensity falls by the cosine of the angle to the axis to this power.
    #[serde(default)]
    pub vignetting: f64,
    /// A picture of the film instead of the waves: PNG, TIFF or EXR, its values are the transmission (linear, no
    /// gamma), it fills the film. A path in a spec file starts from that file's folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(serialize_with = "nelu3d_scan::path_text::serialize_option")]
    pub image: Option<PathBuf>,
    /// Plane waves per color, 1 to 64. Few keep the contrast, many avoid repetition.
    #[serde(default = "waves")]
    pub waves: usize,
    /// Shortest period on the film, mm.
    #[serde(default = "one")]
    pub min_period_mm: f64,
    /// Longest period on the film, mm.
    #[serde(default = "five")]
    pub max_period_mm: f64,
    /// Waves run along the film's rows give or take this angle. A change of depth shifts the pattern along the line
    /// from lamp to camera only, so waves across that line tell nothing.
    #[serde(default = "any_direction")]
    pub spread: f64,
    /// Seed of the film's waves.
    #[serde(default)]
    pub seed: u64,
}

fn white() -> [f64; 3] {
    [1.0; 3]
}

fn waves() -> usize {
    4
}

fn five() -> f64 {
    5.0
}

fn any_direction() -> f64 {
    std::f64::consts::FRAC_PI_2
}
