//! The light source: anything that throws a pattern.

use std::path::PathBuf;

use nelu3d_scan::camera::{Camera, Distortion};
use serde::{Deserialize, Serialize};

use super::PerColor;
use super::camera::identity;

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
    /// What the black image is.
    pub fn black(&self) -> BlackImage {
        match self {
            LightSpec::Projector(p) => p.black,
            LightSpec::Film(_) => BlackImage::Off,
        }
    }
}

/// What is captured as black.png.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BlackImage {
    /// The light source is off: ambient light only.
    #[default]
    Off,
    /// The light source shows its darkest image: ambient light and its leak.
    Darkest,
}

/// A projector. Its rays leave one point; a surface at distance d receives (reference/d)² of the reference irradiance, inside
/// the lit square of a white pixel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProjectorSpec {
    /// Columns of the projected image.
    pub width: usize,
    /// Rows of the projected image.
    pub height: usize,
    /// Focal length along x, px.
    pub fx: f64,
    /// Focal length along y, px.
    pub fy: f64,
    /// Principal point, px.
    pub cx: f64,
    /// Principal point, px.
    pub cy: f64,
    /// OpenCV's distortion coefficients: 0, 4, 5, 8, 12 or 14 of them.
    #[serde(default)]
    pub distortion: Vec<f64>,
    /// Where its center is in the camera's frame, mm.
    pub position_mm: [f64; 3],
    /// The point its optical axis passes through, mm. Without roll its rows lie level with the camera's.
    pub target_mm: [f64; 3],
    /// Turn about its axis, radians, from its +x to its +y.
    #[serde(default)]
    pub roll: f64,
    /// Distance at which the irradiance of the flash is 1, mm.
    pub reference_mm: f64,
    /// Side of a pixel's lit square, as a part of the pixels' pitch: the rest are dark gaps. The area that is lit is its square.
    #[serde(default = "one")]
    pub fill_factor: f64,
    /// Depth (in the projector's frame) of sharpest focus on the optical axis, mm.
    pub focus_mm: f64,
    /// Tilt of the plane of sharpest focus: radians by which it recedes toward the projector's +x and +y.
    #[serde(default)]
    pub focus_tilt: [f64; 2],
    /// Standard deviation of the lens's blur at the focus, projector px; the pixel's own square comes on top.
    pub sharp_sigma_px: f64,
    /// Diameter of the lens's opening, mm: blur grows with it away from the focus.
    pub aperture_mm: f64,
    /// Intensity falls by the cosine of the angle to the optical axis to this power.
    #[serde(default)]
    pub vignetting: f64,
    /// Light that a black projector pixel still emits, as a part of a white one's.
    #[serde(default)]
    pub black_leak: f64,
    /// Light = code to this power; a number for all channels, or one each.
    #[serde(default = "linear")]
    pub gamma: PerColor,
    /// Light of each channel (rows: red, green, blue) in the camera's bands (columns). The flash is their sum.
    #[serde(default = "identity")]
    pub primaries: [[f64; 3]; 3],
    /// What black.png is.
    #[serde(default)]
    pub black: BlackImage,
}

fn any_direction() -> f64 {
    std::f64::consts::FRAC_PI_2
}

fn one() -> f64 {
    1.0
}

fn linear() -> PerColor {
    PerColor::Same(1.0)
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

impl ProjectorSpec {
    /// The optics, or `None` for a number of distortion coefficients that OpenCV does not know.
    pub(crate) fn optics(&self) -> Option<Camera> {
        let distortion = Distortion::new(&self.distortion)?;
        let pinhole = Camera::pinhole(self.width, self.height, self.fx, self.fy, self.cx, self.cy);
        Some(Camera { distortion, ..pinhole })
    }
}

/// A color film before a small lamp, which throws the film's shadow on the scene, and a white lamp beside it.
///
/// The film's transmission is a sum of plane waves per color, whose blur by the lamp's size has a closed form, or an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilmSpec {
    /// Where the lamp behind the film is in the camera's frame, mm.
    pub position_mm: [f64; 3],
    /// The point its axis passes through, mm.
    pub target_mm: [f64; 3],
    /// Where the white lamp is relative to the other, camera's frame, mm. Away from zero, white and pattern light fall
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
    /// A picture of the film instead of the waves: PNG, TIFF or EXR, its values are the transmission (linear, no gamma), it
    /// fills the film. A path in a spec file starts from that file's folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
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
    /// Waves run along the film's rows give or take this angle. A change of depth shifts the pattern along the line from
    /// lamp to camera only, so waves across that line tell nothing.
    #[serde(default = "any_direction")]
    pub spread: f64,
    /// Seed of the film's waves.
    #[serde(default)]
    pub seed: u64,
}
