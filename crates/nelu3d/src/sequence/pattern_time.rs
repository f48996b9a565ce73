//! The time of a pattern relative to its white image.

use nelu3d_scan::Camera;
use nelu3d_scan::rig::Capture;
use rayon::prelude::*;

use super::motion::Motion;
use crate::color_field::{CameraRays, ColorField, SplineEvaluator};
use crate::sensor::DarkLevel;

/// Times that are tried first, frames from the white image.
const TRIED: [f32; 17] =
    [-1.0, -0.875, -0.75, -0.625, -0.5, -0.375, -0.25, -0.125, 0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0];
/// Largest number of pixels that are compared.
const MAX_PIXELS: usize = 6_000;
/// Fewest pixels that tell a time.
const MIN_PIXELS: usize = 100;
/// χ² per measurement at which a pixel's cost saturates.
const SATURATION: f32 = 9.0;

/// The time at which a pattern was taken, in frames from its white image.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PatternTime {
    /// Time of the pattern in frames; negative where it comes before its white image.
    pub frames: f32,
    /// Fraction of χ² between codewords and surface that goes away when the white image is drawn at that time.
    pub explained: f32,
}

/// The estimation of a pattern time from a capture with its white image as it was taken, and a surface.
pub(super) struct PatternTimeProblem<'a> {
    /// Motion of the white image's points.
    pub(super) motion: &'a Motion,
    /// The capture.
    pub(super) capture: &'a Capture,
    /// Camera z per pixel of the patterns, mm; NaN where there is none.
    pub(super) depth: &'a [f32],
    /// The camera.
    pub(super) camera: &'a Camera,
    /// The color field.
    pub(super) field: &'a ColorField,
}

impl PatternTimeProblem<'_> {
    /// Estimates the time of the patterns at which surface and codewords agree best, near `near` if that is known.
    /// `None` if fewer than a hundred pixels can tell.
    pub(super) fn solve(&self, near: Option<f32>) -> Option<PatternTime> {
        let all: Vec<usize> = (0..self.depth.len()).filter(|i| self.depth[*i].is_finite()).collect();
        let pixels: Vec<usize> = all.iter().copied().step_by(all.len() / MAX_PIXELS + 1).collect();
        if pixels.len() < MIN_PIXELS {
            return None;
        }
        let codewords = self.codewords(&pixels);
        let k = codewords.len() / pixels.len();
        // Summed in order: the result is the same on any number of threads.
        let cost = |t: f32| -> f64 {
            let one = |(i, c): (&usize, &[f32])| self.pixel_cost(*i, c, t);
            let costs: Vec<f64> =
                pixels.par_iter().zip(codewords.par_chunks_exact(k)).with_min_len(256).map(one).collect();
            costs.iter().sum()
        };
        let still = cost(0.0);
        let (frames, min) = minimize(&cost, near);
        Some(PatternTime { frames, explained: if still > 0.0 { (1.0 - min / still) as f32 } else { 0.0 } })
    }

    /// Codewords of the surface at some pixels, `pixels × k`.
    fn codewords(&self, pixels: &[usize]) -> Vec<f32> {
        let grid = self.field.to_grid();
        let spline = SplineEvaluator::new(&grid, self.field.metadata.cells_per_pixel);
        let k = self.capture.patterns.len() * self.capture.white.channels;
        let width = self.camera.width;
        let places: Vec<[usize; 2]> = pixels.iter().map(|i| [i % width, i / width]).collect();
        let rays = CameraRays::of_pixels(self.camera, self.field, &places);
        let mut codewords = vec![0.0; pixels.len() * k];
        codewords.par_chunks_exact_mut(k).zip(pixels).enumerate().with_min_len(256).for_each(|(n, (c, i))| {
            let t = f64::from(self.depth[*i] / rays.dir_z(n));
            spline.eval(rays.in_frame(n).at(t).q, c);
        });
        codewords
    }

    /// Saturating χ² between pixel `i` and the surface's codeword `c` there, with the white image drawn at time `t`,
    /// frames.
    fn pixel_cost(&self, i: usize, c: &[f32], t: f32) -> f64 {
        let white = &self.capture.white;
        let channels = white.channels;
        let mut drawn = vec![0.0; channels];
        self.motion.white_pixel_at(white, i % white.width, i / white.width, t, &mut drawn);
        let mut chi2 = 0.0;
        for (m, pattern) in self.capture.patterns.iter().enumerate() {
            for ch in 0..channels {
                let own = white.data[i * channels + ch];
                let black = match &self.capture.black {
                    Some(black) => black.data[i * channels + ch],
                    None => self.field.metadata.dark.get(ch).map_or(0.0, |d: &DarkLevel| d.at(own)),
                };
                // The weight is that of the white image as taken, so that no time gains from having less light.
                let light = (own - black).max(1e-3);
                let c = c[m * channels + ch];
                let variance = self.field.metadata.noise.normalized_variance(c.clamp(0.0, 1.0), light, black);
                let r = (pattern.data[i * channels + ch] - black - c * (drawn[ch] - black)) / light;
                chi2 += r * r / variance;
            }
        }
        let limit = SATURATION * c.len() as f32;
        f64::from(chi2 / (1.0 + chi2 / limit))
    }
}

/// Minimizes a smooth cost over time, from a time near the minimum or from the best of [`TRIED`], by parabolas through
/// ever closer neighbors. Returns the time, frames, and its cost.
fn minimize(cost: &dyn Fn(f32) -> f64, near: Option<f32>) -> (f32, f64) {
    let (mut frames, mut min) = match near {
        Some(near) => (near, cost(near)),
        None => {
            let tried = TRIED.map(cost);
            let best = (0..TRIED.len()).min_by(|a, b| tried[*a].total_cmp(&tried[*b])).expect("some were tried");
            (TRIED[best], tried[best])
        }
    };
    let mut width = 0.0625;
    for _ in 0..if near.is_some() { 2 } else { 3 } {
        let (a, b) = (cost(frames - width), cost(frames + width));
        let bend = a - 2.0 * min + b;
        let next = frames
            + if bend > 0.0 { (0.5 * (a - b) / bend) as f32 * width } else { 0.0 }.clamp(-1.5 * width, 1.5 * width);
        let next_cost = cost(next);
        if next_cost < min {
            (frames, min) = (next, next_cost);
        }
        width *= 0.4;
    }
    (frames, min)
}
