//! XOR codes: Gray code without wide stripes, so that light that bounces within the scene blurs to a constant in every
//! image (Gupta, Agrawal, Veeraraghavan and Narasimhan, "Structured Light 3D Scanning in the Presence of Global
//! Illumination", CVPR 2011).

use serde::{Deserialize, Serialize};

use super::axis::Axis;
use super::bits::{BitCode, base_bit};
use super::error::PatternError;
use crate::image::Image;

/// Gray code whose images are all XORed with one of fine stripes, the base plane, which itself is shown as it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Xor {
    /// Direction of change.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Width of the base plane's stripes, px: 2 is the paper's XOR-02, 4 its XOR-04.
    #[serde(default = "two")]
    #[cfg_attr(feature = "clap", arg(long = "base", value_name = "PX", default_value_t = 2))]
    pub base_px: u32,
    /// Make the inverse of every image, too.
    #[serde(default)]
    #[cfg_attr(feature = "clap", arg(long))]
    pub inverse: bool,
}

fn two() -> u32 {
    2
}

impl Xor {
    pub(super) fn generate(&self, width: usize, height: usize) -> Result<[Vec<Image>; 2], PatternError> {
        let base_bit = base_bit(self.base_px, self.axis.length(width, height))?;
        Ok(BitCode::Xor { base_bit }.generate(self.axis, self.inverse, width, height))
    }
}

/// Decodes the column (or row) that every pixel saw: [`BitCode::decode_images`] of [`BitCode::Xor`], whose base plane
/// has stripes of `base_px`.
///
/// # Panics
///
/// As [`BitCode::decode_images`], and if `base_px` is no power of 2 from 2 up.
pub fn decode_xor(images: &[Image], inverse: &[Image], base_px: u32, min_contrast: f32) -> Vec<Option<u32>> {
    let base_bit = base_bit(base_px, 1 << images.len().min(31)).expect("a width that makes a base plane");
    BitCode::Xor { base_bit }.decode_images(images, inverse, min_contrast)
}
