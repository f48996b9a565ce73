//! Traces of lossy compression: a JPEG's blocks of 8 × 8 pixels meet in steps that the scene does not have.

use nelu3d_scan::Image;

use super::dark_level::row_step;

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
    /// Adds an image, its first channel; of large ones, every so many-th row.
    pub fn add(&mut self, image: &Image) {
        let (w, h, c) = (image.width, image.height, image.channels);
        let at = |x: usize, y: usize| image.data[(y * w + x) * c];
        for y in (1..h).step_by(row_step(image)) {
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
