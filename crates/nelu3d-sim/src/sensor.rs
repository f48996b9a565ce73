//! The sensor: from light to codes.
//!
//! With L the light a pixel collects (1: albedo 1, facing the flash at its reference distance), the expected number of
//! electrons is `(electrons_per_sec · L + dark_electrons_per_sec) · exposure_secs`. Photons and dark current make it a
//! Poisson number, reading adds Gaussian noise, and the converter scales `[0, full well / gain]` to `[black level,
//! largest code]`, rounds and clips. (The converter ends where the well does or before, so that a full pixel always
//! reads the largest code.)

use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, Normal, Poisson};

use crate::spec::CameraSpec;

/// A sensor with shot noise, dark current, read noise, gain, clipping and quantization.
#[derive(Clone, Debug)]
pub struct Sensor {
    /// Electrons of each channel for a light of 1.
    electrons: [f64; 3],
    dark: f64,
    /// Electrons at the largest code.
    at_saturation: f64,
    read_noise: Normal<f64>,
    black_level: f64,
    saturation: f64,
}

impl Sensor {
    /// Returns the sensor of a camera.
    ///
    /// # Panics
    ///
    /// If the camera's read noise is not finite, which [`Spec::check`](crate::Spec::check) finds.
    pub fn new(camera: &CameraSpec) -> Self {
        Self {
            electrons: camera.electrons_per_sec.rgb().map(|e| e * camera.exposure_secs),
            dark: camera.dark_electrons_per_sec * camera.exposure_secs,
            at_saturation: camera.full_well_electrons / camera.gain,
            read_noise: Normal::new(0.0, camera.read_noise_electrons).expect("checked with the spec"),
            black_level: camera.black_level,
            saturation: camera.saturation(),
        }
    }

    /// Samples the code of a pixel of a channel (0 to 2) that collects `light`, as (code − black level) / (saturation −
    /// black level).
    pub fn read(&self, light: f32, channel: usize, random: &mut Xoshiro256PlusPlus) -> f32 {
        let mean = self.electrons[channel] * f64::from(light).max(0.0) + self.dark;
        // A Poisson number of mean 0 is 0; the library's distribution has no such mean.
        let photons = if mean > 0.0 { Poisson::new(mean).map_or(mean, |p| p.sample(random)) } else { 0.0 };
        let electrons = photons + self.read_noise.sample(random);
        let range = self.saturation - self.black_level;
        let code = (electrons / self.at_saturation * range + self.black_level).round().clamp(0.0, self.saturation);
        ((code - self.black_level) / range) as f32
    }
}
