//! How much more a field's depths scatter than noise makes them.

use serde::{Deserialize, Serialize};

/// The variance of errors in depth at positions that were held out, over what the noise model gives, per χ² per
/// measurement there: 1 where errors along the code's slope are as large as those across it, which are all that a scan
/// shows. Errors of a field (cells that are wider than the code's edges, noise of the sweep) go with the slope, and
/// neighbors share them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthNoise {
    /// Ratio of variances of depth errors of single pixels, and of means over squares of 2, 4, and 8 pixels, beside what
    /// squares of 16 share.
    pub by_side: [f64; DepthNoise::SIDES],
}

impl DepthNoise {
    /// Number of sides of squares: 1, 2, 4, 8 px.
    pub const SIDES: usize = 4;

    /// Returns the factor of the noise's variance for depths that average over so many pixels; at least 1.
    pub fn factor(&self, pixels: f32) -> f32 {
        let at = (0.5 * pixels.max(1.0).log2()).min((Self::SIDES - 1) as f32);
        let i = (at as usize).min(Self::SIDES - 2);
        let [before, after] = [self.by_side[i], self.by_side[i + 1]].map(|v| v as f32);
        (before + (at - i as f32) * (after - before)).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_of_any_size_lie_between_those_that_were_measured() {
        let noise = DepthNoise { by_side: [2.0, 4.0, 8.0, 0.5] };
        for (pixels, expected) in [(0.1, 2.0), (1.0, 2.0), (4.0, 4.0), (8.0, 6.0), (16.0, 8.0), (64.0, 1.0), (1e4, 1.0)]
        {
            assert!((noise.factor(pixels) - expected).abs() < 1e-6, "{pixels}: {}", noise.factor(pixels));
        }
    }
}
