//! An image at several scales, for motion that is looked for coarse to fine.

use nelu3d_scan::statistics::median;

/// Number of pixels to which images are reduced before the flow is estimated: motion changes slowly over an image.
const MAX_PIXELS: usize = 20_000;
/// Smallest side of the coarsest image, px.
const MIN_SIDE: usize = 20;

/// An image at ever smaller scales, without those at which no motion is looked for.
pub struct Pyramid {
    /// Width and height of the image, px.
    size: [usize; 2],
    /// The scales, each half of the one before it.
    pub(super) levels: Vec<Level>,
}

impl Pyramid {
    /// Reduces an image, of channels of `height × width` values, because a surface may vary in color alone.
    ///
    /// # Panics
    ///
    /// If there are no channels, or one has another size.
    pub fn new(channels: Vec<Vec<f32>>, width: usize, height: usize) -> Self {
        assert!(!channels.is_empty() && channels.iter().all(|v| v.len() == width * height), "channels of one size");
        let size = [width, height];
        let mut level = Level { size, channels };
        let mut levels = Vec::new();
        loop {
            let half = (level.size[0].min(level.size[1]) >= 2 * MIN_SIDE).then(|| level.half());
            // Of scales that are too fine only the next one is needed.
            if half.is_none() || level.size[0] * level.size[1] <= MAX_PIXELS {
                levels.push(level);
            }
            match half {
                Some(half) => level = half,
                None => return Self { size, levels },
            }
        }
    }

    /// Returns the finest scale at which motion is looked for.
    pub(super) fn finest(&self) -> &Level {
        &self.levels[0]
    }

    /// Returns the pixels of the image to one of the finest scale, along x and y.
    pub(super) fn spacing(&self) -> [f32; 2] {
        [0, 1].map(|c| self.size[c] as f32 / self.finest().size[c] as f32)
    }
}

/// An image at one scale.
pub(super) struct Level {
    /// Width and height, px.
    pub(super) size: [usize; 2],
    /// The channels of the image, each `height × width` values, row by row.
    pub(super) channels: Vec<Vec<f32>>,
}

impl Level {
    /// Returns the level of half the size, of means over 2 × 2 pixels.
    fn half(&self) -> Self {
        let [w, h] = self.size.map(|v| v / 2);
        let width = self.size[0];
        let reduce = |v: &Vec<f32>| -> Vec<f32> {
            let of = |i: usize| {
                let at = 2 * (i / w) * width + 2 * (i % w);
                0.25 * (v[at] + v[at + 1] + v[at + width] + v[at + width + 1])
            };
            (0..w * h).map(of).collect()
        };
        Self { size: [w, h], channels: self.channels.iter().map(reduce).collect() }
    }

    /// Returns the noise variance of one pixel in a channel, from the second differences in the quieter half of the
    /// image.
    pub(super) fn noise(&self, channel: usize) -> f32 {
        let rows = self.channels[channel].chunks_exact(self.size[0]);
        let mut d: Vec<f32> =
            rows.flat_map(|r| r.windows(3).step_by(3).map(|v| (v[0] - 2.0 * v[1] + v[2]).powi(2) / 6.0)).collect();
        // The median of a squared normal variable is 0.455 of its mean.
        median(&mut d).map_or(1e-6, |middle| (middle / 0.455).max(1e-7))
    }
}
