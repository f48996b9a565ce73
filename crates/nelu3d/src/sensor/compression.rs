//! Traces of lossy compression: a JPEG's blocks of 8 × 8 pixels meet in steps that the scene does not have.

use nelu3d_scan::Image;

/// Side of a block, px.
const BLOCK: usize = 8;
/// Differences above this are edges of the scene and count no more than this; linear intensity.
const EDGE: f32 = 0.01;

/// Sums of the differences between neighboring pixels, by where in a block of 8 pixels they are.
#[derive(Clone, Debug, Default)]
pub struct BlockDetector {
    /// Across and down, per phase: sum and number.
    sums: [[(f64, u64); BLOCK]; 2],
}

impl BlockDetector {
    /// Adds an image, its first channel.
    pub fn add(&mut self, image: &Image) {
        let (w, h, c) = (image.width, image.height, image.channels);
        let at = |x: usize, y: usize| image.data[(y * w + x) * c];
        for y in 1..h {
            for x in 1..w {
                let v = at(x, y);
                if v >= 1.0 {
                    continue;
                }
                for (axis, phase, before) in [(0, x % BLOCK, at(x - 1, y)), (1, y % BLOCK, at(x, y - 1))] {
                    let of = &mut self.sums[axis][phase];
                    *of = (of.0 + f64::from((v - before).abs().min(EDGE)), of.1 + 1);
                }
            }
        }
    }

    /// Joins another detector's sums.
    pub fn merge(&mut self, other: &Self) {
        for (a, b) in self.sums.as_flattened_mut().iter_mut().zip(other.sums.as_flattened()) {
            *a = (a.0 + b.0, a.1 + b.1);
        }
    }

    /// Returns by how much steps between blocks exceed those within them: 1 where there are no blocks, of both axes the
    /// smaller. A phase is compared with those of its own parity only, since demosaicing has a period of two pixels.
    pub fn excess(&self) -> f64 {
        const MIN_SAMPLES: u64 = 500;
        let of_axis = |sums: &[(f64, u64); BLOCK]| {
            let mean = |phase: usize| {
                let (sum, n) = sums[phase % BLOCK];
                if n < MIN_SAMPLES { f64::NAN } else { sum / n as f64 }
            };
            let ratio = |phase: usize| 3.0 * mean(phase) / [2, 4, 6].map(|d| mean(phase + d)).iter().sum::<f64>();
            (0..BLOCK).map(ratio).filter(|r| r.is_finite()).fold(1.0, f64::max)
        };
        of_axis(&self.sums[0]).min(of_axis(&self.sums[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_told_from_noise_and_from_mosaics() {
        let mut state = 1u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            0.004 * ((state >> 33) as f32 / (1u64 << 30) as f32 - 1.0)
        };
        let mut plain = Image::new(160, 160, 1);
        plain.data.iter_mut().for_each(|v| *v = 0.4 + noise());
        let excess = |image: &Image| {
            let (mut all, mut d) = (BlockDetector::default(), BlockDetector::default());
            d.add(image);
            all.merge(&d);
            all.excess()
        };
        assert!(excess(&plain) < 1.05, "{}", excess(&plain));
        let mut mosaic = plain.clone();
        (0..160 * 160).filter(|i| i % 2 == 1).for_each(|i| mosaic.data[i] = mosaic.data[i - 1]);
        assert!(excess(&mosaic) < 1.05, "{}", excess(&mosaic));
        // Each block is smooth, and a little off its neighbors.
        let mut blocks = plain.clone();
        for i in 0..160 * 160 {
            let block = (i % 160 / 8 * 7 + i / 160 / 8 * 13) % 5;
            blocks.data[i] = 0.4 + 0.0015 * block as f32 + 0.3 * (plain.data[i] - 0.4);
        }
        assert!(excess(&blocks) > 1.3, "{}", excess(&blocks));
    }
}
