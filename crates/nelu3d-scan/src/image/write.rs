//! PNG files from linear images and from pictures.

use std::io::{self, Write};
use std::path::Path;

use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::{ExtendedColorType, ImageEncoder, ImageError};
use rayon::prelude::*;

use super::Image;
use crate::output::write_atomic;

/// Writes a linear image as 8-bit sensor codes `value · (saturation − black_level) + black_level`, rounded and limited
/// to 0..=255: the inverse of reading with the same two levels.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_png8(path: &Path, image: &Image, black_level: f64, saturation: f64) -> io::Result<()> {
    let codes: Vec<u8> =
        image.data.par_iter().map(|&v| code(v, black_level, saturation).clamp(0.0, 255.0) as u8).collect();
    let kind = if image.channels == 3 { ExtendedColorType::Rgb8 } else { ExtendedColorType::L8 };
    write_png(path, &codes, image.width, image.height, image.channels, 1, kind)
}

/// Writes a linear image as [`write_png8`] does, with 16-bit codes limited to 0..=65535.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_png16(path: &Path, image: &Image, black_level: f64, saturation: f64) -> io::Result<()> {
    let codes: Vec<[u8; 2]> = image
        .data
        .par_iter()
        .map(|&v| (code(v, black_level, saturation).clamp(0.0, 65535.0) as u16).to_ne_bytes())
        .collect();
    let kind = if image.channels == 3 { ExtendedColorType::Rgb16 } else { ExtendedColorType::L16 };
    write_png(path, codes.as_flattened(), image.width, image.height, image.channels, 2, kind)
}

/// Writes an 8-bit color picture of `height × width × 3` bytes.
///
/// # Errors
///
/// The file cannot be written.
///
/// # Panics
///
/// If `data` has another length.
pub fn write_rgb8(path: &Path, width: usize, height: usize, data: &[u8]) -> io::Result<()> {
    write_png(path, data, width, height, 3, 1, ExtendedColorType::Rgb8)
}

/// Writes an 8-bit gray picture of `height × width` bytes.
///
/// # Errors
///
/// The file cannot be written.
///
/// # Panics
///
/// If `data` has another length.
pub fn write_gray8(path: &Path, width: usize, height: usize, data: &[u8]) -> io::Result<()> {
    write_png(path, data, width, height, 1, 1, ExtendedColorType::L8)
}

fn code(value: f32, black_level: f64, saturation: f64) -> f64 {
    (f64::from(value) * (saturation - black_level) + black_level).round()
}

/// Writes codes as they are: `height × width × channels` values of `bytes_per_value` bytes in the machine's order.
pub(crate) fn write_png(
    path: &Path,
    bytes: &[u8],
    width: usize,
    height: usize,
    channels: usize,
    bytes_per_value: usize,
    kind: ExtendedColorType,
) -> io::Result<()> {
    assert_eq!(bytes.len(), width * height * channels * bytes_per_value, "picture data of another size");
    let size = |n: usize| u32::try_from(n).map_err(|_| io::Error::other("too large for a PNG file"));
    write_atomic(path, |w: &mut dyn Write| {
        // Captures hardly compress: the fast setting costs a few percent of size and saves most of the time.
        let encoder = PngEncoder::new_with_quality(w, CompressionType::Fast, FilterType::Adaptive);
        encoder.write_image(bytes, size(width)?, size(height)?, kind).map_err(|e| match e {
            ImageError::IoError(e) => e,
            other => io::Error::other(other),
        })
    })
}
