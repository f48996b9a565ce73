//! The dark level: light that is there without the light source, estimated from the sweep for scenes without a black
//! image.

use nelu3d_scan::Image;
use serde::{Deserialize, Serialize};

/// The intensity of a pixel without the light source, as `offset + ambient · white`: light that does not depend on the
/// object (sensor, veiling glare), and ambient light, which an object reflects as it does the white (flash) image's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DarkLevel {
    /// Linear intensity that does not depend on the object.
    pub offset: f32,
    /// Fraction of the white image that is ambient light.
    #[serde(rename = "share", alias = "ambient")]
    pub ambient: f32,
    /// Mean white − black of the pixels that are lit in all channels: the color of the light on the board. 0 if
    /// unknown.
    #[serde(default)]
    pub light: f32,
}

impl DarkLevel {
    /// Returns the expected black level of a pixel whose white is `white`.
    pub fn at(&self, white: f32) -> f32 {
        (self.offset + self.ambient * white).clamp(0.0, white.max(0.0))
    }
}

/// Number of pixels of an image that are enough for means over it.
const ENOUGH: usize = 2_000_000;

/// Returns how far apart rows of an image may be for means over it: an odd number, so that a pattern of a power of two
/// rows is seen whole.
pub(super) fn row_step(image: &Image) -> usize {
    (image.width * image.height / ENOUGH) | 1
}

/// Regression of black on white, per channel, over the lit pixels of a sweep. Paper and ink of the board separate
/// offset from ambient fraction.
#[derive(Clone, Default)]
pub struct DarkEstimator {
    /// Per channel: n, Σw, Σb, Σw², Σwb.
    sums: Vec<[f64; 5]>,
    /// Per channel: Σ (w − b) of the pixels that are lit in all channels, and their number.
    light: Vec<[f64; 2]>,
}

impl DarkEstimator {
    /// Adds a position's white and black images, of large ones every so many-th row. Clipped pixels and those with less
    /// contrast than `min_contrast` are skipped.
    pub fn add(&mut self, white: &Image, black: &Image, min_contrast: f32) {
        self.sums.resize(white.channels, [0.0; 5]);
        self.light.resize(white.channels, [0.0; 2]);
        let (n, stride) = (white.channels, (white.width * white.channels).max(1));
        let rows = white.data.chunks_exact(stride).zip(black.data.chunks_exact(stride));
        for (white, black) in rows.step_by(row_step(white)) {
            for (w, b) in white.chunks_exact(n).zip(black.chunks_exact(n)) {
                if w.iter().zip(b).all(|(w, b)| w - b >= min_contrast && *w < 1.0) {
                    for (sum, (w, b)) in self.light.iter_mut().zip(w.iter().zip(b)) {
                        *sum = [sum[0] + f64::from(w - b), sum[1] + 1.0];
                    }
                }
            }
            for (i, (w, b)) in white.iter().zip(black).enumerate() {
                if w - b >= min_contrast && *w < 1.0 {
                    let (w, b) = (f64::from(*w), f64::from(*b));
                    for (s, v) in self.sums[i % n].iter_mut().zip([1.0, w, b, w * w, w * b]) {
                        *s += v;
                    }
                }
            }
        }
    }

    /// Joins another estimator's sums.
    pub fn merge(&mut self, other: &Self) {
        self.sums.resize(self.sums.len().max(other.sums.len()), [0.0; 5]);
        for (a, b) in self.sums.iter_mut().zip(&other.sums) {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        }
        self.light.resize(self.light.len().max(other.light.len()), [0.0; 2]);
        for (a, b) in self.light.iter_mut().zip(&other.light) {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        }
    }

    /// Returns the level per channel. Neither part is negative.
    pub fn finish(&self) -> Vec<DarkLevel> {
        self.sums
            .iter()
            .zip(&self.light)
            .map(|([n, w, b, ww, wb], [light, lit])| {
                let light = if *lit >= 100.0 { (light / lit) as f32 } else { 0.0 };
                if *n < 100.0 {
                    return DarkLevel { light, ..DarkLevel::default() };
                }
                let var = ww / n - (w / n).powi(2);
                let slope = if var > 1e-6 { (wb / n - w / n * b / n) / var } else { 0.0 };
                let ambient = slope.clamp(0.0, 0.9);
                let offset = (b / n - ambient * w / n).max(0.0);
                DarkLevel { offset: offset as f32, ambient: ambient as f32, light }
            })
            .collect()
    }
}
