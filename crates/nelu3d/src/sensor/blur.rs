//! Blur of the camera, and where in the image the light of a pixel comes from.
//!
//! A pixel measures light from all around its middle. Where that is evenly bright, its codeword is that of the middle.
//! At an edge of brightness most of the light comes from the bright side, and the codeword is that of a place there:
//! away from the middle by s² times the gradient of the logarithm of white − black (Tweedie's formula; Efron, "Tweedie's
//! Formula and Selection Bias", *J. Am. Stat. Assoc.* 2011), where s² is the variance of the blur, the pixel's own area
//! included. With fine patterns and a soft lens that is most of what a board's codewords are off by.

use serde::{Deserialize, Serialize};

/// Longest shift, standard deviations of the blur: light from farther away is little.
const LONGEST: f32 = 1.5;

/// Variance of a pixel's own area along each axis, square pixels.
const AREA: f32 = 1.0 / 12.0;

/// Variance of a camera's blur along each axis of the image, square pixels (or blocks of them), the pixel's own area
/// included.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Blur(f32);

impl Blur {
    /// A blur of a variance.
    pub fn new(variance: f32) -> Self {
        Self(variance)
    }

    /// The blur of optics that blur by a Gaussian of a standard deviation, px, and of a pixel's own area.
    pub fn of_optics(sigma: f32) -> Self {
        Self(sigma * sigma + AREA)
    }

    /// Returns the blur of blocks of `side` × `side` pixels, square blocks.
    pub fn of_blocks(self, side: usize) -> Self {
        Self((self.0 - AREA) / (side * side) as f32 + AREA)
    }

    /// Returns the variance, square pixels.
    pub fn variance(self) -> f32 {
        self.0
    }

    /// Returns how far beside a pixel's middle its light comes from in the mean, pixels, by the gradient of the
    /// logarithm of what it sees, per pixel.
    #[inline]
    pub fn shift(self, gradient: [f32; 2]) -> [f32; 2] {
        let size = self.0 * gradient[0].hypot(gradient[1]);
        let most = LONGEST * self.0.sqrt();
        let scale = if size > most { self.0 * most / size } else { self.0 };
        gradient.map(|g| scale * g)
    }
}
