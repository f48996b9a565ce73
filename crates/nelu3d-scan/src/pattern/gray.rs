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
