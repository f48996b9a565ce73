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
pub(crate) struct Sensor {
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
    /// Returns the sensor of a checked spec.
    pub(crate) fn new(camera: &CameraSpec) -> Self {
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
    pub(crate) fn read(&self, light: f32, channel: usize, random: &mut Xoshiro256PlusPlus) -> f32 {
        let mean = self.electrons[channel] * f64::from(light).max(0.0) + self.dark;
        // A Poisson number of mean 0 is 0; the library's distribution has no such mean.
        let photons = if mean > 0.0 { Poisson::new(mean).map_or(mean, |p| p.sample(random)) } else { 0.0 };
        let electrons = photons + self.read_noise.sample(random);
        let range = self.saturation - self.black_level;
        let code = (electrons / self.at_saturation * range + self.black_level).round().clamp(0.0, self.saturation);
        ((code - self.black_level) / range) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{RandomPurpose, generator};
    use crate::spec::Spec;

    /// Mean and variance of codes, for light from black to nearly full, against the photon transfer curve:
    /// variance = k² (electrons + read noise²) + 1/12, with k = gain · range / full well codes per electron.
    #[test]
    fn the_photon_transfer_curve_is_the_declared_one() {
        let plain = CameraSpec { black_level: 100.0, ..Spec::preset("demo").unwrap().camera };
        // All: a gain, an exposure, a dark current of 0, of some, of many electrons.
        for (place, (gain, exposure_secs, dark)) in
            [(1.0, 0.01, 0.0), (4.0, 0.002, 5e3), (16.0, 0.2, 1e3)].iter().enumerate()
        {
            let rates = [0.9, 1.0, 0.7].map(|v| v * plain.full_well_electrons / gain / exposure_secs);
            let camera = CameraSpec {
                gain: *gain,
                exposure_secs: *exposure_secs,
                dark_electrons_per_sec: *dark,
                electrons_per_sec: crate::spec::PerColor::Each(rates),
                ..plain.clone()
            };
            let sensor = Sensor::new(&camera);
            let range = camera.saturation() - camera.black_level;
            let k = gain * range / camera.full_well_electrons;
            let n = 20_000;
            for (i, light) in [0.0, 0.002, 0.05, 0.3, 0.6].into_iter().enumerate() {
                let channel = i % 3;
                let mut random = generator(1, RandomPurpose::Sensor, [i as u64, place as u64, 0]);
                let codes: Vec<f64> =
                    (0..n).map(|_| f64::from(sensor.read(light, channel, &mut random)) * range).collect();
                let mean = codes.iter().sum::<f64>() / f64::from(n);
                let variance = codes.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / f64::from(n - 1);
                let electrons = (f64::from(light) * rates[channel] + dark) * exposure_secs;
                let expected = k * k * (electrons + camera.read_noise_electrons.powi(2)) + 1.0 / 12.0;
                // Five standard errors of a mean and of a variance.
                let error = 5.0 * (expected / f64::from(n)).sqrt();
                assert!((mean - k * electrons).abs() < error, "{light}: mean {mean}, not {}", k * electrons);
                let error = 5.0 * expected * (2.0 / f64::from(n)).sqrt() * (1.0 + 0.5 / electrons.max(1.0));
                assert!((variance - expected).abs() < error, "{light}: variance {variance}, not {expected}");
            }
        }
    }

    #[test]
    fn codes_are_whole_and_end_at_saturation() {
        let camera = Spec::preset("demo").unwrap().camera;
        let sensor = Sensor::new(&camera);
        let mut random = generator(1, RandomPurpose::Sensor, [0, 0, 0]);
        for light in [0.0, 0.4, 1e6] {
            let code = f64::from(sensor.read(light, 0, &mut random)) * (camera.saturation() - camera.black_level);
            assert!((code - code.round()).abs() < 1e-3);
            if light > 1.0 {
                assert_eq!(code, camera.saturation() - camera.black_level);
            }
        }
        // A gain of 8 ends at an eighth of the well: 0.8 · 0.2 of it is beyond.
        let sensor = Sensor::new(&CameraSpec { gain: 8.0, ..camera.clone() });
        assert_eq!(sensor.read(0.2, 0, &mut random), 1.0);
    }
}
