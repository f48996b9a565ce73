//! The sweep in memory: normalized intensities of every board position, each image read once.

use half::f16;
use nelu3d_scan::Image;

use super::noise::NoiseModel;

/// All positions of a sweep as normalized intensities, at the camera's resolution or, where that would not fit the memory
/// budget, averaged over square blocks of pixels.
pub struct Sweep {
    /// Samples across.
    pub width: usize,
    /// Samples down.
    pub height: usize,
    /// Pixels along the side of one sample's block; 1 = full resolution.
    pub block: usize,
    /// Pattern channels.
    pub k: usize,
    /// Channels of the white image: 1 or 3. Pattern channel j is normalized by white channel `j % channels`.
    pub channels: usize,
    /// The positions, in the order of the sweep.
    pub positions: Vec<Position>,
}

/// One board position.
pub struct Position {
    /// Name of its folder.
    pub name: String,
    /// Normalized intensity, `height × width × k`.
    pub values: Vec<f16>,
    /// white − black, `height × width × channels`; 0 where the sample cannot be used.
    pub contrast: Vec<f16>,
}

impl Sweep {
    /// Pixel coordinates of the center of a sample's block.
    pub fn px(&self, x: usize, y: usize) -> [f64; 2] {
        let half = (self.block as f64 - 1.0) / 2.0;
        [(x * self.block) as f64 + half, (y * self.block) as f64 + half]
    }

    /// Number of samples in a position.
    pub fn n(&self) -> usize {
        self.width * self.height
    }

    /// Side of the blocks that keep `n_positions` positions under `budget` bytes.
    pub fn block_for(n_pixels: usize, k: usize, channels: usize, n_positions: usize, budget: usize) -> usize {
        let bytes = n_pixels * (k + channels) * 2 * n_positions;
        (1..).find(|f| bytes / (f * f) <= budget).expect("some block is large enough")
    }

    /// The values of a sample as f32 with their weights (one over the variance; 0 = unusable); false when none is usable.
    #[inline]
    pub fn sample(&self, p: usize, i: usize, noise: &NoiseModel, v: &mut [f32], w: &mut [f32]) -> bool {
        let position = &self.positions[p];
        let mut any = false;
        let area = (self.block * self.block) as f32;
        for j in 0..self.k {
            let contrast = position.contrast[i * self.channels + j % self.channels].to_f32();
            v[j] = position.values[i * self.k + j].to_f32();
            w[j] = 0.0;
            if contrast > 0.0 {
                w[j] = area / noise.normalized_variance(v[j], contrast, 0.0);
                any = true;
            }
        }
        any
    }
}

/// Builds a [`Position`] image by image, so that only white, black and one pattern are in memory at a time.
pub struct PositionBuilder {
    white: Image,
    black: Image,
    k: usize,
    values: Vec<f32>,
    filled: usize,
    usable: Vec<bool>,
}

impl PositionBuilder {
    /// Starts a position from its white and black images; `threshold` is the least usable white − black.
    pub fn new(white: Image, black: Image, k: usize, threshold: f32) -> Self {
        let usable = white.data.iter().zip(&black.data).map(|(w, b)| *w < 1.0 && w - b >= threshold).collect();
        let values = vec![0.0; white.width * white.height * k];
        Self { white, black, k, values, filled: 0, usable }
    }

    /// Adds the next pattern image. A clipped pixel is unusable in that channel.
    pub fn add(&mut self, pattern: &Image) {
        let c = self.white.channels;
        assert_eq!(pattern.data.len(), self.white.data.len());
        for (i, p) in pattern.data.iter().enumerate() {
            let (px, ch) = (i / c, i % c);
            let contrast = self.white.data[i] - self.black.data[i];
            if *p >= 1.0 {
                self.usable[i] = false;
            }
            if self.usable[i] {
                self.values[px * self.k + self.filled + ch] = (p - self.black.data[i]) / contrast;
            }
        }
        self.filled += c;
    }

    /// The finished position, averaged over blocks of `block` pixels. A block is usable where all its pixels are.
    pub fn finish(self, name: String, block: usize) -> Position {
        assert_eq!(self.filled, self.k);
        let (w, h, c, k) = (self.white.width / block, self.white.height / block, self.white.channels, self.k);
        let mut values = Vec::with_capacity(w * h * k);
        let mut contrast = Vec::with_capacity(w * h * c);
        let pixels = |x: usize, y: usize| {
            let width = self.white.width;
            (0..block * block).map(move |i| (y * block + i / block) * width + x * block + i % block)
        };
        let share = 1.0 / (block * block) as f32;
        for y in 0..h {
            for x in 0..w {
                for j in 0..k {
                    // The mean weighted by contrast is the ratio of mean intensities, as a larger pixel would have seen it.
                    let (mut num, mut den) = (0.0, 0.0);
                    for i in pixels(x, y) {
                        let d = self.white.data[i * c + j % c] - self.black.data[i * c + j % c];
                        num += d * self.values[i * k + j];
                        den += d;
                    }
                    values.push(f16::from_f32(if den > 0.0 { num / den } else { 0.0 }));
                }
                for ch in 0..c {
                    let usable = pixels(x, y).all(|i| self.usable[i * c + ch]);
                    let d: f32 = pixels(x, y).map(|i| self.white.data[i * c + ch] - self.black.data[i * c + ch]).sum();
                    contrast.push(f16::from_f32(if usable { d * share } else { 0.0 }));
                }
            }
        }
        Position { name, values, contrast }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(v: [f32; 4]) -> Image {
        Image { width: 2, height: 2, channels: 1, data: v.to_vec() }
    }

    #[test]
    fn normalizes_and_marks_unusable_pixels() {
        let mut b = PositionBuilder::new(image([0.5, 0.5, 0.015, 1.0]), image([0.1, 0.0, 0.0, 0.0]), 2, 0.02);
        b.add(&image([0.3, 0.25, 0.01, 0.2]));
        b.add(&image([0.1, 1.0, 0.01, 0.2]));
        let p = b.finish("000".into(), 1);
        assert_eq!(p.values[0].to_f32(), 0.5);
        assert_eq!(p.values[1].to_f32(), 0.0);
        let usable: Vec<bool> = p.contrast.iter().map(|c| c.to_f32() > 0.0).collect();
        assert_eq!(usable, [true, false, false, false]);
    }

    #[test]
    fn blocks_keep_a_sweep_within_its_budget() {
        assert_eq!(Sweep::block_for(640 * 480, 3, 1, 34, 2 << 30), 1);
        let f = Sweep::block_for(31_000_000, 11, 1, 200, 2 << 30);
        assert!(31_000_000 / (f * f) * 12 * 2 * 200 <= 2 << 30 && f > 1);
    }
}
