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
