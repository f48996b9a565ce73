//! What Gray, binary and XOR codes share: a column's number as bits, one image a bit.

use super::axis::{Axis, along};
use super::error::PatternError;
use crate::image::Image;

/// How the bits of a column's number are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BitCode {
    /// The number itself.
    Binary,
    /// Reflected: neighbors differ in one bit (Gray 1953; Inokuchi, Sato and Matsuda 1984 for range finding).
    Gray,
    /// Gray, every bit but one XORed with that one, the base plane, so that no image has wide stripes (Gupta, Agrawal,
    /// Veeraraghavan and Narasimhan, CVPR 2011). `base_bit` is the base plane's bit: 0 in XOR-02, 1 in XOR-04, after
    /// the width in px of the base plane's stripes.
    Xor {
        /// The base plane, counted from the least significant bit.
        base_bit: u32,
    },
}

impl BitCode {
    /// Returns the code of column `u`, its bits in the order of significance; `u < 2^bits`.
    pub fn word(self, u: u32, bits: u32) -> u32 {
        let gray = u ^ (u >> 1);
        match self {
            BitCode::Binary => u,
            BitCode::Gray => gray,
            BitCode::Xor { base_bit } => gray ^ others(gray, base_bit, bits),
        }
    }

    /// Returns the inverse of [`BitCode::word`].
    pub fn column(self, word: u32, bits: u32) -> u32 {
        let gray = match self {
            BitCode::Binary => return word,
            BitCode::Gray => word,
            BitCode::Xor { base_bit } => word ^ others(word, base_bit, bits),
        };
        // Each bit of the number is the exclusive or of all bits of the code down to it.
        [1, 2, 4, 8, 16].into_iter().fold(gray, |u, shift| u ^ (u >> shift))
    }

    /// Decodes the column of one pixel from its normalized intensities, the most significant bit first; `inverse` are
    /// those of the inverse images, or empty, in which case ½ is the threshold.
    ///
    /// `None` where any bit differs from its threshold by less than `min_contrast` (in units of white; with inverses:
    /// the difference of the two images), or is no number. A column may lie beyond the images' last one: there are more
    /// codes than columns.
    ///
    /// # Panics
    ///
    /// If there are no values, more than 32, or `inverse` has another length and is not empty.
    pub fn decode(self, values: &[f32], inverse: &[f32], min_contrast: f32) -> Option<u32> {
        assert!((1..=32).contains(&values.len()), "a code of {} bits", values.len());
        assert!(inverse.is_empty() || inverse.len() == values.len(), "one inverse per image, or none");
        let mut word = 0;
        for (b, value) in values.iter().enumerate() {
            let difference = value - inverse.get(b).unwrap_or(&0.5);
            // NaN must not decode.
            if difference.abs() < min_contrast || difference.is_nan() {
                return None;
            }
            word = word << 1 | u32::from(difference > 0.0);
        }
        Some(self.column(word, values.len() as u32))
    }

    /// Makes the images of all bits, the most significant first, and their inverses if asked for (else none): `height ×
    /// width`, one channel, 0 or 1.
    pub fn generate(self, axis: Axis, inverse: bool, width: usize, height: usize) -> [Vec<Image>; 2] {
        let bits = n_bits(axis.length(width, height));
        let image =
            |b: u32, flip: u32| along(axis, width, height, |u| f64::from((self.word(u as u32, bits) >> b & 1) ^ flip));
        let images = (0..bits).rev().map(|b| image(b, 0)).collect();
        let inverse = if inverse { (0..bits).rev().map(|b| image(b, 1)).collect() } else { Vec::new() };
        [images, inverse]
    }

    /// Decodes every pixel as [`BitCode::decode`] does. Images of one size and channel.
    ///
    /// # Panics
    ///
    /// As [`BitCode::decode`], and if the images are of several channels or of different sizes.
    pub fn decode_images(self, images: &[Image], inverse: &[Image], min_contrast: f32) -> Vec<Option<u32>> {
        assert!(!images.is_empty(), "a code of 0 bits");
        let n = images[0].width * images[0].height;
        assert!(images.iter().chain(inverse).all(|i| i.channels == 1 && i.data.len() == n), "images of one size, gray");
        let (mut values, mut inverses) = (vec![0.0; images.len()], vec![0.0; inverse.len()]);
        (0..n)
            .map(|i| {
                values.iter_mut().zip(images).for_each(|(v, image)| *v = image.data[i]);
                inverses.iter_mut().zip(inverse).for_each(|(v, image)| *v = image.data[i]);
                self.decode(&values, &inverses, min_contrast)
            })
            .collect()
    }
}

/// Returns all bits but the base plane, if the base plane is set in `word`.
fn others(word: u32, base_bit: u32, bits: u32) -> u32 {
    let all = u32::MAX >> (32 - bits);
    if word >> base_bit & 1 == 1 { all & !(1 << base_bit) } else { 0 }
}

/// Returns the number of bits needed to number `n` columns; at least one.
pub(super) fn n_bits(n: usize) -> u32 {
    usize::BITS - n.saturating_sub(1).max(1).leading_zeros()
}

/// Returns the base plane's bit for its stripes' width.
pub(super) fn base_bit(base_px: u32, columns: usize) -> Result<u32, PatternError> {
    let good = base_px >= 2 && base_px.is_power_of_two() && base_px.trailing_zeros() <= n_bits(columns);
    if good {
        return Ok(base_px.trailing_zeros() - 1);
    }
    let remedy = "give a power of 2 from 2 to the number of columns, as 2 (XOR-02) or 4 (XOR-04)";
    Err(PatternError::Setting { family: "xor", key: "base_px", value: f64::from(base_px), remedy })
}
