//! Projectors.

use nelu3d_scan::camera::Camera;
use serde::{Deserialize, Serialize};

use super::camera::{PerColor, opencv_camera};
use super::defaults::{identity, one};

/// State of the light source in black.png.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BlackImage {
    /// The light source is off: ambient light only.
    #[default]
    Off,
    /// The light source shows its darkest image: ambient light and its leak.
    Darkest,
}

/// A projector. Its rays leave one point; a surface at distance d receives (reference/d)² of the reference irradiance,
/// inside the lit square of a white pixel.
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
    /// Position of its center in the camera's frame, mm.
    pub position_mm: [f64; 3],
    /// The point its optical axis passes through, mm. Without roll its rows lie level with the camera's.
    pub target_mm: [f64; 3],
    /// Turn about its axis, radians, from its +x to its +y.
    #[serde(default)]
    pub roll: f64,
    /// Distance at which the irradiance of the flash is 1, mm.
    pub reference_mm: f64,
    /// Side of a pixel's lit square, as a part of the pixels' pitch: the rest are dark gaps. The area that is lit is
    /// its square.
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
    /// State of the light source in black.png.
    #[serde(default)]
    pub black: BlackImage,
}

fn linear() -> PerColor {
    PerColor::Same(1.0)
}

impl ProjectorSpec {
    /// Returns the optics, or `None` for a number of distortion coefficients that OpenCV does not know.
    pub(crate) fn optics(&self) -> Option<Camera> {
        opencv_camera([self.width, self.height], [self.fx, self.fy, self.cx, self.cy], &self.distortion)
    }
}
