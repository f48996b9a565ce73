//! Where in the image the light of the pixels comes from.
//!
//! A codeword is that of the surface seen there (see [`crate::sensor::Blur`]): at an outline the surface farther in, at
//! an edge of the texture that on its bright side. Its inverse depth is that in the pixel's middle, and its slope times
//! the distance.

use rayon::prelude::*;

use super::window::Window;
use crate::sensor::{Blur, Measurements, NoiseModel};

/// Times the variance that noise gives it which the square of a gradient has to exceed.
const NOISE: f32 = 3.0;

/// How far beside the middles of pixels their light comes from.
pub struct Seen {
    /// Along x and y, per pixel of a window, px; empty: from the middle.
    shifts: Vec<[f32; 2]>,
}

impl Seen {
    /// Finds the places of the active pixels of a window. Without a blur they are the middles of the pixels.
    pub fn new(m: &Measurements, noise: &NoiseModel, blur: Option<Blur>, window: &Window, active: &[bool]) -> Self {
        let Some(blur) = blur else { return Self { shifts: Vec::new() } };
        let shift = |i: usize| {
            if !active[i] {
                return [0.0; 2];
            }
            let ([x, y], variance) = m.log_gradient(window.at(i), noise);
            let above_noise = 1.0 - NOISE * variance / (x * x + y * y).max(f32::MIN_POSITIVE);
            blur.shift([x, y]).map(|s| s * above_noise.max(0.0))
        };
        Self { shifts: (0..active.len()).into_par_iter().with_min_len(window.w).map(shift).collect() }
    }

    /// Returns how far beside the middle of pixel `i` of the window its light comes from, px.
    #[inline]
    pub fn shift(&self, i: usize) -> [f32; 2] {
        self.shifts.get(i).copied().unwrap_or_default()
    }

    /// Returns the unknown where the light comes from, of `x` in the middles of pixels and its slopes per pixel.
    pub fn of(&self, x: &[f32], slopes: &[[f32; 2]]) -> Vec<f32> {
        let of = |i: usize| {
            let ([dx, dy], [sx, sy]) = (self.shift(i), slopes[i]);
            x[i] + dx * sx + dy * sy
        };
        (0..x.len()).map(of).collect()
    }
}
