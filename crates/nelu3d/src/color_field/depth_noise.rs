//! How much more a field's depths scatter than noise makes them.

use serde::{Deserialize, Serialize};

/// The variance of errors in depth at positions that were held out, over what the noise model gives, per χ² per
/// measurement there: 1 where errors along the code's slope are as large as those across it, which are all that a scan
/// shows. Errors of a field (cells that are wider than the code's edges, noise of the sweep) go with the slope, and
/// neighbors share them. They are larger where fewer positions have lit the same rays of light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthNoise {
    /// Ratio of variances of depth errors of single pixels, and of means over squares of 2, 4, and 8 pixels, beside what
    /// squares of 16 share: of all places together.
    pub by_side: [f64; DepthNoise::SIDES],
    /// Ratios of variances where about as many other positions have lit the same rays, from few to many. Empty where too
    /// little tells them apart, and in fields of older versions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by_support: Vec<SupportedDepthNoise>,
}

/// [`DepthNoise`] at places that about as many positions support.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SupportedDepthNoise {
    /// Number of positions that have lit the same rays of light, on average.
    pub positions: f64,
    /// Ratios of variances, as [`DepthNoise::by_side`].
    pub by_side: [f64; DepthNoise::SIDES],
}

impl DepthNoise {
    /// Number of sides of squares: 1, 2, 4, 8 px.
    pub const SIDES: usize = 4;

    /// Returns the factor of the noise's variance for depths that average over so many pixels, where so many positions
    /// support the field (`None`: not counted); at least 1. Between the numbers of positions that were compared, it is
    /// linear in one over them: averages over n positions have an n-th of their noise.
    pub fn factor(&self, pixels: f32, positions: Option<u8>) -> f32 {
        let inverse = |n: f32| 1.0 / n.max(1.0);
        let of = |s: &SupportedDepthNoise| (inverse(s.positions as f32), of_sides(&s.by_side, pixels));
        let Some((positions, most)) = positions.map(f32::from).zip(self.by_support.last()) else {
            return of_sides(&self.by_side, pixels).max(1.0);
        };
        let factor = match self.by_support.iter().position(|s| s.positions as f32 >= positions) {
            None => of(most).1,
            Some(0) => of(&self.by_support[0]).1,
            Some(i) => {
                let [(at_before, before), (at_after, after)] = [i - 1, i].map(|i| of(&self.by_support[i]));
                let part = (inverse(positions) - at_before) / (at_after - at_before);
                if part.is_finite() { before + part.clamp(0.0, 1.0) * (after - before) } else { after }
            }
        };
        factor.max(1.0)
    }
}

/// The ratio for so many pixels, linear in the logarithm of the side of their square.
fn of_sides(by_side: &[f64; DepthNoise::SIDES], pixels: f32) -> f32 {
    let at = (0.5 * pixels.max(1.0).log2()).min((DepthNoise::SIDES - 1) as f32);
    let i = (at as usize).min(DepthNoise::SIDES - 2);
    let [before, after] = [by_side[i], by_side[i + 1]].map(|v| v as f32);
    before + (at - i as f32) * (after - before)
}
