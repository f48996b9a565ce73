//! Hilbert codes: the column number as the coordinates of a point on a k-dimensional Hilbert curve, neighbors on the
//! line neighbors in code space (Gupta and Nakhate, "A Geometric Perspective on Structured Light Coding", ECCV 2018;
//! the form here is that of LookUp3D's patterns).

use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use super::bits::n_bits;
use super::codewords::Codewords;
use super::error::PatternError;
use crate::image::Image;

/// Column u's coordinates on the curve, b = ⌈log₂(columns) / k⌉ bits each; image j shows
/// `((coordinate + 1) · 2^(8 − b) − 1) / 255` of coordinate j.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Hilbert {
    /// Direction of change.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Number of images, the curve's dimensions.
    #[serde(default = "three")]
    #[cfg_attr(feature = "clap", arg(long, value_name = "K", default_value_t = 3))]
    pub count: usize,
}

fn three() -> usize {
    3
}

impl Hilbert {
    pub(super) fn generate(&self, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
        let n = self.axis.length(width, height);
        let words = hilbert_codewords(n, self.count)?;
        Ok((0..self.count).map(|j| along(self.axis, width, height, |u| f64::from(words.word(u)[j]))).collect())
    }
}

/// Returns the codewords of `n` columns in `k` images; [`Codewords::nearest`] decodes them.
///
/// # Errors
///
/// `k` is not 2 to 16, or the columns would need more than 8 bits an image.
pub fn hilbert_codewords(n: usize, k: usize) -> Result<Codewords, PatternError> {
    let wrong = |remedy| PatternError::Setting { family: "hilbert", key: "count", value: k as f64, remedy };
    if !(2..=16).contains(&k) {
        return Err(wrong("give 2 to 16 images"));
    }
    let bits = n_bits(n).div_ceil(k as u32);
    if bits > 8 {
        return Err(wrong("give more images: so many columns need more than 8 bits in each"));
    }
    let value = |coordinate: u32| ((((coordinate + 1) << (8 - bits)) - 1) as f64 / 255.0) as f32;
    Ok(Codewords::new(k, (0..n as u64).flat_map(|u| hilbert_point(u, k, bits)).map(value).collect()))
}

/// Returns the point at `index` along the Hilbert curve of `k` dimensions, `bits` each (Skilling, "Programming the
/// Hilbert curve", AIP Conference Proceedings 707, 2004): `k` coordinates below 2^bits. There are
/// 2^(bits · k) indices; the next index is the next point, one step away along one coordinate.
pub fn hilbert_point(index: u64, k: usize, bits: u32) -> Vec<u32> {
    // The index's bits dealt out, from the most significant, to one coordinate after the other.
    let mut x = vec![0_u32; k];
    for b in 0..bits as usize * k {
        let bit = (index >> (bits as usize * k - 1 - b)) as u32 & 1;
        x[b % k] |= bit << (bits as usize - 1 - b / k);
    }
    // Gray code of the index.
    let carry = x[k - 1] >> 1;
    for i in (1..k).rev() {
        x[i] ^= x[i - 1];
    }
    x[0] ^= carry;
    // Undo the rotations and reflections of every level, from the finest but one to the coarsest.
    for level in 1..bits {
        let (q, low) = (1_u32 << level, (1_u32 << level) - 1);
        for i in (0..k).rev() {
            if x[i] & q != 0 {
                x[0] ^= low;
            } else {
                let swap = (x[0] ^ x[i]) & low;
                x[0] ^= swap;
                x[i] ^= swap;
            }
        }
    }
    x
}
