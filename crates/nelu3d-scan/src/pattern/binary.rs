//! Binary code: the column (or row) number as it is.

use serde::{Deserialize, Serialize};

use super::axis::Axis;
use super::bits::BitCode;
use crate::image::Image;

/// One image per bit of the number, the most significant first. Where bits change together a pixel on the edge may
/// decode to a column far away, which is what [`super::Gray`] avoids.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Binary {
    /// Direction of change.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Make the inverse of every image, too.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(long))]
    pub inverse: bool,
}

impl Binary {
    pub(super) fn generate(&self, width: usize, height: usize) -> [Vec<Image>; 2] {
        BitCode::Binary.generate(self.axis, self.inverse, width, height)
    }
}

/// Decodes the column (or row) that every pixel saw: [`BitCode::decode_images`] of [`BitCode::Binary`].
///
/// # Panics
///
/// As [`BitCode::decode_images`].
pub fn decode_binary(images: &[Image], inverse: &[Image], min_contrast: f32) -> Vec<Option<u32>> {
    BitCode::Binary.decode_images(images, inverse, min_contrast)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_image_halves_the_columns() {
        let [images, inverse] = Binary { axis: Axis::X, inverse: true }.generate(256, 1);
        assert_eq!((images.len(), inverse.len()), (8, 8));
        for u in 0..256 {
            assert_eq!(images[0].data[u], if u < 128 { 0.0 } else { 1.0 });
            assert_eq!(images[7].data[u], (u % 2) as f32);
            assert_eq!(images[7].data[u] + inverse[7].data[u], 1.0);
        }
        assert_eq!(decode_binary(&images, &inverse, 0.1)[77], Some(77));
    }
}
