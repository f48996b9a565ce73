//! The normalized images of one board position.

use nelu3d_scan::Image;
use nelu3d_scan::image::box_mean;
use rayon::prelude::*;

use crate::sensor::{Intensities, NoiseModel};

/// Light that reaches a pixel by other ways than from the point that it sees (veiling glare, interreflection), as a
/// fraction of the light around it: on black ink that is a good part of what is measured, and noise does not say so.
/// Pixels about as bright as their surroundings have none: there it is part of what the field describes.
const STRAY_LIGHT: f32 = 0.03;
/// Largest ratio of the light around to the own one that paper has, where light falls off.
const PAPER: f32 = 2.0;
/// Radius of the surroundings that stray light comes from, as a fraction of the image's width.
const SURROUNDINGS: f32 = 1.0 / 16.0;
/// Error of a codeword where the contrast of ink and paper changes by its own size from a pixel to the next. There the
/// place that the pixel's light comes from (see [`super::blur`]) is not known better than to half a pixel; the slope of
/// a fine code is half its range per pixel.
const EDGE: f32 = 0.25;

/// The normalized intensities of one board position.
pub struct Position {
    /// Width, samples.
    pub width: usize,
    /// Height, samples.
    pub height: usize,
    /// Number of pattern channels.
    pub k: usize,
    /// Number of channels of the white image.
    pub channels: usize,
    /// Normalized intensity, `height × width × k`.
    pub values: Vec<f32>,
    /// White − black, `height × width × channels`; 0 where the sample cannot be used.
    pub contrast: Vec<f32>,
    /// White − black that does not follow a pixel's own noise, `height × width × channels`: what weights are made from;
    /// empty for [`Self::contrast`].
    pub light: Vec<f32>,
    /// White − black of what is bright around a sample, `height × width`: its mean weighted by itself.
    pub around: Vec<f32>,
    /// Variance of a sample's values that edges of ink beside it leave open, `height × width`.
    pub edge: Vec<f32>,
}

impl Position {
    /// Returns the values of a sample, and writes their weights (one over the variance from noise, stray light, and edges
    /// of ink; 0 = unusable) to `w`; `None` when no value is usable.
    #[inline]
    pub fn sample(&self, i: usize, noise: &NoiseModel, w: &mut [f32]) -> Option<&[f32]> {
        let v = &self.values[i * self.k..(i + 1) * self.k];
        if !self.is_usable(i) {
            return None;
        }
        for (j, (w, v)) in w.iter_mut().zip(v).enumerate() {
            *w = self.weight(i, j, *v, noise);
        }
        Some(v)
    }

    /// Returns whether any value of a sample is usable.
    #[inline]
    pub(super) fn is_usable(&self, i: usize) -> bool {
        self.contrast[i * self.channels..][..self.channels].iter().any(|c| *c > 0.0)
    }

    /// Writes the weights of a sample with which it goes into means: those of [`Self::sample`] for values in mid range.
    /// Dark values are less noisy than bright ones, and a mean of both that gave each its own weight would be too dark:
    /// by a hundredth where many positions meet in a pixel on the slope of a fringe.
    #[inline]
    pub fn weights_in_means(&self, i: usize, noise: &NoiseModel, w: &mut [f32]) {
        for (j, w) in w.iter_mut().enumerate() {
            *w = self.weight(i, j, 0.5, noise);
        }
    }

    /// Returns one over the variance of channel `j` of a sample for the value `v`; 0 where it is unusable.
    #[inline]
    fn weight(&self, i: usize, j: usize, v: f32, noise: &NoiseModel) -> f32 {
        let at = i * self.channels + j % self.channels;
        if self.contrast[at] <= 0.0 {
            return 0.0;
        }
        let contrast = self.light.get(at).copied().unwrap_or(self.contrast[at]);
        let stray = STRAY_LIGHT * (self.around[i] / contrast - PAPER).max(0.0);
        1.0 / (noise.normalized_variance(v, contrast, 0.0) + stray * stray + self.edge[i])
    }

    /// Returns the mean of the channels' contrast at a sample.
    #[inline]
    fn mean_contrast_at(&self, i: usize) -> f32 {
        match self.channels {
            1 => self.contrast[i],
            c => self.contrast[i * c..(i + 1) * c].iter().sum::<f32>() / c as f32,
        }
    }

    /// Returns the gradient of the logarithm of the contrast at a sample, per sample along x and y: 0 along an axis where
    /// both neighbors are unusable, or one is outside. Where one is unusable, too dark or clipped, the other tells it.
    #[inline]
    pub fn log_gradient(&self, i: usize) -> [f32; 2] {
        let (x, y, own) = (i % self.width, i / self.width, self.mean_contrast_at(i));
        let along = |at: usize, end: usize, stride: usize| {
            if at == 0 || at + 1 >= end || own <= 0.0 {
                return 0.0;
            }
            let [before, after] = [i - stride, i + stride].map(|j| self.mean_contrast_at(j));
            match (before > 0.0, after > 0.0) {
                (true, true) => (after - before) / (2.0 * own),
                (true, false) => (own - before) / own,
                (false, true) => (after - own) / own,
                (false, false) => 0.0,
            }
        };
        [along(x, self.width, 1), along(y, self.height, self.width)]
    }

    /// Returns the position averaged over blocks of `block × block` pixels, as a camera of larger pixels would have
    /// measured it. A block is usable where all its pixels are.
    pub fn reduced(&self, block: usize) -> Self {
        self.reduced_by(&self.contrast, block)
    }

    /// Returns [`Self::reduced`] with another contrast, `height × width × channels`.
    pub(super) fn reduced_by(&self, contrast: &[f32], block: usize) -> Self {
        let of_pixels = contrast;
        let (w, h, c, k) = (self.width / block, self.height / block, self.channels, self.k);
        let mut values = Vec::with_capacity(w * h * k);
        let mut contrast = Vec::with_capacity(w * h * c);
        let pixels = |x: usize, y: usize| {
            (0..block * block).map(move |i| (y * block + i / block) * self.width + x * block + i % block)
        };
        let norm = 1.0 / (block * block) as f32;
        for y in 0..h {
            for x in 0..w {
                for j in 0..k {
                    // The mean weighted by contrast is the ratio of mean intensities, as a larger pixel measures it.
                    let (mut num, mut den) = (0.0, 0.0);
                    for i in pixels(x, y) {
                        let d = of_pixels[i * c + j % c];
                        num += d * self.values[i * k + j];
                        den += d;
                    }
                    values.push(if den > 0.0 { num / den } else { 0.0 });
                }
                for ch in 0..c {
                    let usable = pixels(x, y).all(|i| of_pixels[i * c + ch] > 0.0);
                    let d: f32 = pixels(x, y).map(|i| of_pixels[i * c + ch]).sum();
                    contrast.push(if usable { d * norm } else { 0.0 });
                }
            }
        }
        let around = (0..w * h).map(|i| pixels(i % w, i / w).map(|i| self.around[i]).sum::<f32>() * norm).collect();
        let (light, edge) = (Vec::new(), Vec::new());
        let mut reduced = Self { width: w, height: h, k, channels: c, values, contrast, light, around, edge };
        reduced.edge = reduced.edges();
        reduced
    }

    /// Returns the mean of the channels' contrast, `height × width`.
    fn mean_contrast(&self) -> Vec<f32> {
        let c = self.channels;
        self.contrast.chunks_exact(c).map(|d| d.iter().sum::<f32>() / c as f32).collect()
    }

    /// Returns the variances of [`Self::edge`]. Paper beside an edge has next to none: what little light it has from
    /// beyond the edge is ink's.
    fn edges(&self) -> Vec<f32> {
        let (w, h, mean) = (self.width, self.height, self.mean_contrast());
        let mut edges = vec![0.0; w * h];
        edges.par_chunks_mut(w.max(1)).enumerate().for_each(|(y, row)| {
            let [above, below] = [y.saturating_sub(1), (y + 1).min(h - 1)];
            for (x, edge) in row.iter_mut().enumerate() {
                let own = mean[y * w + x];
                if own > 0.0 {
                    let across = mean[y * w + (x + 1).min(w - 1)] - mean[y * w + x.saturating_sub(1)];
                    let down = mean[below * w + x] - mean[above * w + x];
                    let missing = (2.0 * (1.0 - own / self.around[y * w + x])).clamp(0.0, 1.0);
                    *edge = (EDGE * missing / (2.0 * own)).powi(2) * (across * across + down * down);
                }
            }
        });
        edges
    }

    /// Takes the contrast of what is bright around every sample, and the edges beside it. Weighted by itself, the mean
    /// is that of paper whether much or little of the surroundings is ink.
    fn look_around(&mut self) {
        let mut mean = self.mean_contrast();
        self.around = mean.iter().map(|d| d * d).collect();
        let radius = ((self.width as f32 * SURROUNDINGS) as usize).max(1);
        box_mean(&mut mean, self.width, self.height, radius);
        box_mean(&mut self.around, self.width, self.height, radius);
        for (around, mean) in self.around.iter_mut().zip(&mean) {
            *around = if *mean > 0.0 { *around / mean } else { 0.0 };
        }
        self.edge = self.edges();
    }
}

/// Builds a [`Position`] image by image, so that only white, black and one pattern are in memory at a time.
pub struct PositionBuilder {
    black: Image,
    noise: Option<NoiseModel>,
    /// Black as the noise has it, and its means; empty without a noise model.
    blacks: Intensities,
    /// Number of pattern channels so far.
    filled: usize,
    position: Position,
}

impl PositionBuilder {
    /// Starts a position from its white and black images; `threshold` is the smallest usable white − black. With a noise
    /// model, values and weights are free of what noise does to their means: see [`Intensities`] and
    /// [`NoiseModel::normalized_bias`].
    pub fn new(white: &Image, black: Image, k: usize, threshold: f32, noise: Option<NoiseModel>) -> Self {
        let (width, height, channels) = (white.width, white.height, white.channels);
        let none = || Intensities { own: Vec::new(), mean: Vec::new() };
        let [whites, blacks] = [white, &black].map(|image| noise.map_or_else(none, |n| Intensities::new(image, &n)));
        let mut contrast = white.data.clone();
        for (at, w) in contrast.iter_mut().enumerate() {
            let d = match whites.own.get(at) {
                Some(own) => own - blacks.own[at],
                None => *w - black.data[at],
            };
            *w = if *w < 1.0 && d >= threshold { d } else { 0.0 };
        }
        // As bright as a usable sample, at least.
        let light = whites.mean.iter().zip(&blacks.mean).map(|(w, b)| (w - b).max(threshold)).collect();
        let (values, around, edge) = (vec![0.0; width * height * k], Vec::new(), Vec::new());
        let position = Position { width, height, k, channels, values, contrast, light, around, edge };
        Self { black, noise, blacks, filled: 0, position }
    }

    /// Adds the next pattern image. A clipped pixel is unusable in that channel.
    pub fn add(&mut self, pattern: &Image) {
        let p = &mut self.position;
        let (c, k) = (p.channels, p.k);
        assert_eq!(pattern.data.len(), self.black.data.len());
        let own = self.noise.map(|noise| Intensities::own_where(pattern, &noise, &p.contrast));
        let (own, black) = own.as_ref().map_or((&pattern.data[..], &self.black.data), |own| (own, &self.blacks.own));
        for (at, contrast) in p.contrast.iter_mut().enumerate() {
            if pattern.data[at] >= 1.0 {
                *contrast = 0.0;
            }
            if *contrast > 0.0 {
                let value = (own[at] - black[at]) / *contrast;
                let bias = self.noise.map_or(0.0, |noise| {
                    noise.normalized_bias(value.clamp(0.0, 1.0), p.light[at], self.blacks.mean[at], true)
                });
                p.values[at / c * k + self.filled + at % c] = value - bias;
            }
        }
        self.filled += c;
    }

    /// Returns the black image.
    pub(super) fn black(&self) -> &Image {
        &self.black
    }

    /// Returns the finished position.
    pub fn finish(mut self) -> Position {
        assert_eq!(self.filled, self.position.k);
        self.position.look_around();
        self.position
    }
}
