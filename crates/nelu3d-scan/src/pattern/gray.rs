//! Gray code: the column (or row) number in binary, neighbors differing in one bit.

use serde::{Deserialize, Serialize};

use super::{Axis, along};
use crate::image::Image;

/// One image per bit of the reflected binary code, the most significant first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gray {
    /// Direction of change.
    #[serde(default)]
    pub axis: Axis,
    /// Whether to make the inverse of every image too.
    #[serde(default)]
    pub inverse: bool,
}

impl Gray {
    pub(super) fn generate(&self, width: usize, height: usize) -> [Vec<Image>; 2] {
        let bits = n_bits(self.axis.length(width, height));
        let bit = |b: u32, u: usize| ((u ^ (u >> 1)) >> b & 1) as f64;
        let images = (0..bits).rev().map(|b| along(self.axis, width, height, |u| bit(b, u))).collect();
        let inverse = if self.inverse {
            (0..bits).rev().map(|b| along(self.axis, width, height, |u| 1.0 - bit(b, u))).collect()
        } else {
            Vec::new()
        };
        [images, inverse]
    }
}

/// Bits needed to number `n` columns; at least one.
fn n_bits(n: usize) -> u32 {
    usize::BITS - n.saturating_sub(1).max(1).leading_zeros()
}

/// The column (or row) of the light source's image that every pixel saw, `height × width`.
///
/// `images` are captures, normalized by white and black, in [`Gray`]'s order; `inverse` those of the inverse images, or
/// empty, in which case ½ is the threshold. A pixel is `None` where any bit differs from its threshold by less than
/// `min_contrast` (in units of white; with inverses: the difference of the two images).
///
/// # Panics
///
/// If there are no images, more than 32, images of several channels, or images of different sizes.
pub fn decode_gray(images: &[Image], inverse: &[Image], min_contrast: f32) -> Vec<Option<u32>> {
    assert!((1..=32).contains(&images.len()), "Gray code of {} bits", images.len());
    assert!(inverse.is_empty() || inverse.len() == images.len(), "one inverse per image, or none");
    let n = images[0].width * images[0].height;
    assert!(images.iter().chain(inverse).all(|i| i.channels == 1 && i.data.len() == n), "images of one size, gray");
    (0..n)
        .map(|i| {
            let (mut code, mut binary_bit) = (0, 0);
            for (b, image) in images.iter().enumerate() {
                let difference = image.data[i] - inverse.get(b).map_or(0.5, |inverse| inverse.data[i]);
                // NaN must not decode.
                if difference.abs() < min_contrast || difference.is_nan() {
                    return None;
                }
                // Each bit of the number is the exclusive or of all bits of the code down to it.
                binary_bit ^= u32::from(difference > 0.0);
                code = code << 1 | binary_bit;
            }
            Some(code)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_decode_to_their_columns() {
        for (axis, n) in [(Axis::X, 1), (Axis::X, 2), (Axis::X, 3), (Axis::X, 640), (Axis::Y, 801), (Axis::Y, 1024)] {
            let (w, h) = if axis == Axis::X { (n, 3) } else { (3, n) };
            let [images, inverse] = Gray { axis, inverse: true }.generate(w, h);
            assert!(images.len() == (n.max(2) as f64).log2().ceil() as usize);
            for inverse in [inverse.as_slice(), &[]] {
                let got = decode_gray(&images, inverse, 0.1);
                for (i, code) in got.iter().enumerate() {
                    let expected = if axis == Axis::X { i % w } else { i / w };
                    assert_eq!(*code, Some(expected as u32), "{n} along {axis:?}");
                }
            }
        }
    }

    #[test]
    fn weak_and_absent_bits_do_not_decode() {
        let [mut images, _] = Gray { axis: Axis::X, inverse: false }.generate(64, 1);
        images[2].data[10] = 0.55;
        images[4].data[11] = f32::NAN;
        let got = decode_gray(&images, &[], 0.1);
        assert_eq!((got[9], got[10], got[11], got[12]), (Some(9), None, None, Some(12)));
    }

    #[test]
    fn neighbors_differ_in_one_bit() {
        let [images, _] = Gray { axis: Axis::X, inverse: false }.generate(1000, 1);
        for u in 1..1000 {
            assert_eq!(images.iter().filter(|i| i.data[u] != i.data[u - 1]).count(), 1);
        }
    }
}
