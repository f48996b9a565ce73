//! Gray code: the column (or row) number in binary, neighbors differing in one bit.

use serde::{Deserialize, Serialize};

use super::axis::Axis;
use super::bits::BitCode;
use crate::image::Image;

/// One image per bit of the reflected binary code, the most significant first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Gray {
    /// Direction of change.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Make the inverse of every image, too.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(long))]
    pub inverse: bool,
}

impl Gray {
    pub(super) fn generate(&self, width: usize, height: usize) -> [Vec<Image>; 2] {
        BitCode::Gray.generate(self.axis, self.inverse, width, height)
    }
}

/// Decodes the column (or row) of the light source's image that every pixel saw, `height × width`:
/// [`BitCode::decode_images`] of [`BitCode::Gray`].
///
/// # Panics
///
/// As [`BitCode::decode_images`].
pub fn decode_gray(images: &[Image], inverse: &[Image], min_contrast: f32) -> Vec<Option<u32>> {
    BitCode::Gray.decode_images(images, inverse, min_contrast)
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
    fn neighbors_differ_in_one_bit() {
        let [images, _] = Gray { axis: Axis::X, inverse: false }.generate(1000, 1);
        for u in 1..1000 {
            assert_eq!(images.iter().filter(|i| i.data[u] != i.data[u - 1]).count(), 1);
        }
    }
}
