//! A color film before a small lamp, and a second lamp beside it. There are no pixels: the film's transmission is a sum
//! of plane waves, and the lamp's size damps each of them by a known factor; or it is a picture, blurred by the lamp's
//! disc.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_scan::Image;
use rand::RngExt;

use super::blur::BlurStack;
use super::illumination::Illumination;
use super::sample::{LightSample, point_light_irradiance};
use crate::geometry::look_at;
use crate::random::{RandomPurpose, generator};
use crate::spec::FilmSpec;

/// Film before a small lamp, and a second lamp for the flash.
#[derive(Debug)]
pub(crate) struct FilmLight {
    spec: FilmSpec,
    lamp_from_cam: Isometry3<f64>,
    /// Positions of the white lamp and of the pattern's lamp.
    lamps: [Point3<f64>; 2],
    axis: Vector3<f64>,
    /// Strength of the flash's and of the film's lamp in red, green and blue.
    leds: [[f32; 3]; 2],
    transmission: Transmission,
}

/// The part of light that the film lets through.
#[derive(Debug)]
enum Transmission {
    /// Plane waves of red, green and blue.
    Waves([Vec<Wave>; 3]),
    /// A picture that fills the film, and its width and height, px.
    Picture(Box<BlurStack>, [f64; 2]),
}

/// The plane wave `cos(k · uv + phase)`.
#[derive(Clone, Copy, Debug)]
struct Wave {
    /// Radians per mm on the film.
    k: [f64; 2],
    phase: f64,
}

impl FilmLight {
    /// Returns the film of a spec, with its picture where it has one.
    pub(crate) fn new(spec: &FilmSpec, picture: Option<&Image>) -> Self {
        let cam_from_lamp = look_at(spec.position_mm, spec.target_mm);
        let lamp = Point3::from(spec.position_mm);
        let transmission = match picture.filter(|p| spec.image.is_some() && p.channels == 3) {
            Some(p) => Transmission::Picture(
                Box::new(BlurStack::new(std::slice::from_ref(p))),
                [p.width as f64, p.height as f64],
            ),
            None => Transmission::Waves(Self::waves(spec)),
        };
        Self {
            lamp_from_cam: cam_from_lamp.inverse(),
            lamps: [lamp + Vector3::from(spec.flash_offset_mm), lamp],
            axis: cam_from_lamp * Vector3::z(),
            leds: [spec.flash_led, spec.film_led].map(|led| led.map(|v| v as f32)),
            transmission,
            spec: spec.clone(),
        }
    }

    pub(super) fn move_by(&mut self, motion: &Isometry3<f64>) {
        self.lamps = self.lamps.map(|lamp| motion * lamp);
        self.axis = motion * self.axis;
        self.lamp_from_cam *= motion.inverse();
    }

    fn waves(spec: &FilmSpec) -> [Vec<Wave>; 3] {
        [0, 1, 2].map(|color| {
            let mut random = generator(spec.seed, RandomPurpose::Film, [color, 0, 0]);
            let n = spec.waves;
            (0..n)
                .map(|i| {
                    // One frequency from each of n equal parts of the band: no two waves alike.
                    let part = (i as f64 + random.random::<f64>()) / n as f64;
                    let (low, high) = (1.0 / spec.max_period_mm, 1.0 / spec.min_period_mm);
                    let k = TAU * (low + (high - low) * part);
                    let angle = spec.spread * (2.0 * random.random::<f64>() - 1.0);
                    Wave { k: [k * angle.cos(), k * angle.sin()], phase: TAU * random.random::<f64>() }
                })
                .collect()
        })
    }

    pub(super) fn sample(
        &self,
        p: &Point3<f64>,
        normal: &Vector3<f64>,
        is_visible: &dyn Fn(&Point3<f64>) -> bool,
    ) -> LightSample {
        let s = &self.spec;
        let local = self.lamp_from_cam * p;
        if local.z <= s.film_mm {
            return LightSample::default();
        }
        let strength = self.lamps.map(|lamp| {
            let strength = point_light_irradiance(p, normal, &lamp, &self.axis, s.reference_mm, s.vignetting);
            if strength > 0.0 && is_visible(&lamp) { strength } else { 0.0 }
        });
        let scale = s.film_mm / local.z;
        // Seen from the point, the lamp's disc covers this much of the film.
        LightSample { strength, uv: [local.x * scale, local.y * scale], sigma: s.lamp_sigma_mm * (1.0 - scale) }
    }

    pub(super) fn irradiance(&self, frames: &[Illumination], sample: &LightSample, out: &mut [[f32; 3]]) {
        for (frame, rgb) in frames.iter().zip(out) {
            *rgb = match frame {
                Illumination::White => self.leds[0].map(|led| led * sample.strength[0]),
                Illumination::Black => [0.0; 3],
                Illumination::Pattern(_) if sample.strength[1] == 0.0 || !self.in_image(sample.uv) => [0.0; 3],
                Illumination::Pattern(_) => {
                    let passes = self.transmission(sample.uv, sample.sigma);
                    [0, 1, 2].map(|c| passes[c] * self.leds[1][c] * sample.strength[1])
                }
            };
        }
    }

    /// Returns the transmission in red, green and blue at (u, v) mm under the lamp's disc of standard deviation `sigma`
    /// mm: a picture's, or ½ + ½ · mean of the waves, each damped by exp(−½ σ² |k|²).
    fn transmission(&self, [u, v]: [f64; 2], sigma: f64) -> [f32; 3] {
        let waves = match &self.transmission {
            Transmission::Waves(waves) => waves,
            Transmission::Picture(stack, [w, h]) => {
                let [x, y] = self.spec.film_half_size_mm;
                let mut out = [0.0; 3];
                // Row 0 is at the film's top, which the shadow's top is too: the lamp's frame has y down.
                let at = [(0.5 + 0.5 * u / x) * w - 0.5, (0.5 + 0.5 * v / y) * h - 0.5];
                stack.at(at, sigma * 0.5 * w / x, &mut out);
                return out;
            }
        };
        [0, 1, 2].map(|color| {
            let waves = &waves[color];
            let sum: f64 = waves
                .iter()
                .map(|w| {
                    let damping = (-0.5 * sigma * sigma * (w.k[0] * w.k[0] + w.k[1] * w.k[1])).exp();
                    damping * (w.k[0] * u + w.k[1] * v + w.phase).cos()
                })
                .sum();
            (0.5 + 0.5 * sum / waves.len() as f64) as f32
        })
    }

    pub(super) fn in_image(&self, [u, v]: [f64; 2]) -> bool {
        let [x, y] = self.spec.film_half_size_mm;
        u.abs() <= x && v.abs() <= y
    }
}
