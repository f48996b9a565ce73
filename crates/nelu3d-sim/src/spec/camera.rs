//! The camera: optics and sensor.

use nelu3d_scan::camera::{Camera, Distortion};
use nelu3d_scan::rig::Channels;
use serde::{Deserialize, Serialize};

use super::defaults::{identity, one};

/// One number for all three colors, or one each for red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "give a number, or three for [red, green, blue]")]
pub enum PerColor {
    /// One number for all colors.
    Same(f64),
    /// One number each for red, green and blue.
    Each([f64; 3]),
}

impl PerColor {
    /// Returns the numbers of red, green and blue.
    pub fn rgb(self) -> [f64; 3] {
        match self {
            PerColor::Same(v) => [v; 3],
            PerColor::Each(rgb) => rgb,
        }
    }
}

impl From<f64> for PerColor {
    fn from(v: f64) -> Self {
        PerColor::Same(v)
    }
}

/// A camera: a pinhole with OpenCV's distortion, a point spread function, and a sensor with shot noise, dark current,
/// read noise, gain, clipping and quantization.
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
    /// Bits of a sensor code, 1 to 16. Up to 8 make 8-bit files, more make 16-bit files. The largest code is
    /// saturation.
    pub bits: u32,
    /// Sensor code for no light.
    pub black_level: f64,
    /// Electrons a pixel holds. At a gain of 1 they are the largest code, at a higher one `full_well / gain` are.
    pub full_well_electrons: f64,
    /// Amplification before the converter, 1 or more. It does not amplify the read noise, which counts at its input.
    #[serde(default = "one")]
    pub gain: f64,
    /// Standard deviation of the read noise, electrons.
    pub read_noise_electrons: f64,
    /// Standard deviation of the lens's Gaussian blur, px; the pixel's own area comes on top.
    pub psf_sigma_px: f64,
    /// Electrons per pixel and second from a surface of albedo 1 that faces a white flash at its reference distance: of
    /// each channel, or one number for all. A mono camera has one.
    pub electrons_per_sec: PerColor,
    /// Exposure time, seconds.
    pub exposure_secs: f64,
    /// Dark current, electrons per pixel and second.
    #[serde(default)]
    pub dark_electrons_per_sec: f64,
    /// Moments of the exposure that are averaged where things move, 1 to 64. One freezes the motion.
    #[serde(default = "frozen")]
    pub shutter_samples: usize,
    /// Natural vignetting: a pixel's light falls by the cosine of its angle to the optical axis to this power (4 for a
    /// thin lens).
    #[serde(default)]
    pub vignetting: f64,
    /// Part of each band of light (columns: red, green, blue) that each channel of a color camera collects (rows).
    #[serde(default = "identity")]
    pub color_mixing: [[f64; 3]; 3],
    /// Patterns that an `rgb` camera takes in its mono mode: files of one channel, the luma of its three. Names as in
    /// `rig.toml`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mono_images: Vec<String>,
}

fn frozen() -> usize {
    1
}

impl CameraSpec {
    /// Returns the optics, or `None` for a number of distortion coefficients that OpenCV does not know.
    pub fn optics(&self) -> Option<Camera> {
        opencv_camera([self.width, self.height], [self.fx, self.fy, self.cx, self.cy], &self.distortion)
    }

    /// Returns the color mode, or `None` for an unknown name.
    pub(crate) fn channels(&self) -> Option<Channels> {
        Channels::from_name(&self.channels)
    }

    /// Returns the sensor code at which a value is clipped: the largest code.
    pub fn saturation(&self) -> f64 {
        2f64.powi(self.bits as i32) - 1.0
    }
}

/// Returns a pinhole camera with OpenCV's distortion from its size and `[fx, fy, cx, cy]`, px, or `None` for a number
/// of coefficients that OpenCV does not know.
pub(super) fn opencv_camera(
    [width, height]: [usize; 2],
    [fx, fy, cx, cy]: [f64; 4],
    distortion: &[f64],
) -> Option<Camera> {
    let distortion = Distortion::new(distortion)?;
    Some(Camera { distortion, ..Camera::pinhole(width, height, fx, fy, cx, cy) })
}
