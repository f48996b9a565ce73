//! The sensor: from light to codes.
//!
//! With L the light a pixel collects (1: albedo 1, facing the flash at its reference distance), the expected number of
//! electrons is `exposure · full_well · L`. Photons make it a Poisson number, reading adds Gaussian noise, the well clips
//! it, and the converter scales `[0, full well]` to `[black level, largest code]`, rounds and clips.

use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, Normal, Poisson};

use crate::spec::CameraSpec;

#[derive(Clone, Debug)]
pub(crate) struct Sensor {
    electrons: f64,
    full_well: f64,
    read_noise: Normal<f64>,
    black_level: f64,
    saturation: f64,
}

impl Sensor {
    /// The sensor of a checked spec.
    pub(crate) fn new(camera: &CameraSpec) -> Self {
        Self {
            electrons: camera.exposure * camera.full_well_electrons,
            full_well: camera.full_well_electrons,
            read_noise: Normal::new(0.0, camera.read_noise_electrons).expect("checked with the spec"),
            black_level: camera.black_level,
            saturation: camera.saturation(),
        }
    }

    /// The code of a pixel that collects `light`, as (code − black level) / (saturation − black level).
    pub(crate) fn read(&self, light: f32, random: &mut Xoshiro256PlusPlus) -> f32 {
        let mean = self.electrons * f64::from(light).max(0.0);
        // A Poisson number of mean 0 is 0; the library's distribution has no such mean.
        let photons = if mean > 0.0 { Poisson::new(mean).map_or(mean, |p| p.sample(random)) } else { 0.0 };
        let electrons = (photons + self.read_noise.sample(random)).min(self.full_well);
        let range = self.saturation - self.black_level;
        let code = (electrons / self.full_well * range + self.black_level).round().clamp(0.0, self.saturation);
        ((code - self.black_level) / range) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Use, generator};
    use crate::spec::Spec;

    /// Mean and variance of codes, for light from black to nearly full, against the photon transfer curve:
    /// variance = gain² (electrons + read noise²) + 1/12, gain in codes per electron.
    #[test]
    fn the_photon_transfer_curve_is_the_declared_one() {
        let camera = CameraSpec { black_level: 100.0, exposure: 1.0, ..Spec::preset("demo").unwrap().camera };
        let sensor = Sensor::new(&camera);
        let range = camera.saturation() - camera.black_level;
        let gain = range / camera.full_well_electrons;
        let n = 40_000;
        for (i, light) in [0.0, 0.002, 0.05, 0.3, 0.9].into_iter().enumerate() {
            let mut random = generator(1, Use::Sensor, [i as u64, 0, 0]);
            let codes: Vec<f64> = (0..n).map(|_| f64::from(sensor.read(light, &mut random)) * range).collect();
            let mean = codes.iter().sum::<f64>() / f64::from(n);
            let variance = codes.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / f64::from(n - 1);
            let electrons = f64::from(light) * camera.full_well_electrons;
            let expected = gain * gain * (electrons + camera.read_noise_electrons.powi(2)) + 1.0 / 12.0;
            // Five standard errors of a mean and of a variance.
            let error = 5.0 * (expected / f64::from(n)).sqrt();
            assert!((mean - gain * electrons).abs() < error, "{light}: mean {mean}, not {}", gain * electrons);
            let error = 5.0 * expected * (2.0 / f64::from(n)).sqrt();
            assert!((variance - expected).abs() < error, "{light}: variance {variance}, not {expected}");
        }
    }

    #[test]
    fn codes_are_whole_and_end_at_saturation() {
        let camera = Spec::preset("demo").unwrap().camera;
        let sensor = Sensor::new(&camera);
        let mut random = generator(1, Use::Sensor, [0, 0, 0]);
        for light in [0.0, 0.4, 1e6] {
            let code = f64::from(sensor.read(light, &mut random)) * (camera.saturation() - camera.black_level);
            assert!((code - code.round()).abs() < 1e-3);
            if light > 1.0 {
                assert_eq!(code, camera.saturation() - camera.black_level);
            }
        }
    }
}
