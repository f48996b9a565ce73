//! The camera: optics and sensor.

use nelu3d_scan::camera::{Camera, Distortion};
use nelu3d_scan::rig::Channels;
use serde::{Deserialize, Serialize};

/// A camera: a pinhole with OpenCV's distortion, a point spread function, and a sensor with shot noise, read noise,
/// clipping and quantization.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSpec {
    /// Image width, px.
    pub width: usize,
    /// Image height, px.
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
    /// Color: `mono`, `rgb`, or `bayer-rggb` and its three permutations.
    pub channels: String,
    /// Bits of a sensor code, 1 to 16. Up to 8 make 8-bit files, more make 16-bit files. The largest code is saturation.
    pub bits: u32,
    /// Sensor code for no light.
    pub black_level: f64,
    /// Electrons at saturation. With the code range this fixes the gain and the shot noise.
    pub full_well_electrons: f64,
    /// Standard deviation of the read noise, electrons.
    pub read_noise_electrons: f64,
    /// Standard deviation of the lens's Gaussian blur, px; the pixel's own area comes on top.
    pub psf_sigma_px: f64,
    /// Which part of the full well a surface of albedo 1 fills that faces the flash at its reference distance.
    pub exposure: f64,
    /// How much of each band of light (columns: red, green, blue) each channel of a color camera collects (rows).
    #[serde(default = "identity")]
    pub color_mixing: [[f64; 3]; 3],
}

fn identity() -> [[f64; 3]; 3] {
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
}

impl CameraSpec {
    /// The optics, or `None` for a number of distortion coefficients that OpenCV does not know.
    pub(crate) fn optics(&self) -> Option<Camera> {
        let distortion = Distortion::new(&self.distortion)?;
        let pinhole = Camera::pinhole(self.width, self.height, self.fx, self.fy, self.cx, self.cy);
        Some(Camera { distortion, ..pinhole })
    }

    /// The color mode, or `None` for an unknown name.
    pub(crate) fn channels(&self) -> Option<Channels> {
        Channels::from_name(&self.channels)
    }

    /// The sensor code at which a value is clipped: the largest code.
    pub fn saturation(&self) -> f64 {
        2f64.powi(self.bits as i32) - 1.0
    }
}
