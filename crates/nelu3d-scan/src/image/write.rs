//! PNG files from linear images and from pictures.

use std::io::{self, Write};
use std::path::Path;

use ::png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Filter};
use rayon::prelude::*;

use super::{Image, Raw, RawData};
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
    write_png(path, Codes::U8(&codes), image.width, image.height, image.channels)
}

/// Writes a linear image as [`write_png8`] does, with 16-bit codes limited to 0..=65535.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_png16(path: &Path, image: &Image, black_level: f64, saturation: f64) -> io::Result<()> {
    let codes: Vec<u16> =
        image.data.par_iter().map(|&v| code(v, black_level, saturation).clamp(0.0, 65535.0) as u16).collect();
    write_png(path, Codes::U16(&codes), image.width, image.height, image.channels)
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
    write_png(path, Codes::U8(data), width, height, 3)
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
    write_png(path, Codes::U8(data), width, height, 1)
}

/// Writes a 16-bit gray picture of `height × width` codes.
///
/// # Errors
///
/// The file cannot be written.
///
/// # Panics
///
/// If `data` has another length.
pub fn write_gray16(path: &Path, width: usize, height: usize, data: &[u16]) -> io::Result<()> {
    write_png(path, Codes::U16(data), width, height, 1)
}

fn code(value: f32, black_level: f64, saturation: f64) -> f64 {
    (f64::from(value) * (saturation - black_level) + black_level).round()
}

/// Encodes an 8-bit color picture of `height × width × 3` bytes as PNG.
///
/// # Panics
///
/// If `data` has another length, or the picture is larger than PNG allows (2³² px along a side).
pub fn encode_rgb8(width: usize, height: usize, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode(&mut bytes, Codes::U8(data), [width, height], 3, Compression::Fast)
        .expect("a PNG in memory of matching size cannot fail");
    bytes
}

/// Writes a sensor's codes as they are, as an 8- or 16-bit PNG file: what [`super::decode()`] reads back.
///
/// # Errors
///
/// The file cannot be written, or the codes are floating-point numbers, which PNG does not hold.
pub fn write_raw_png(path: &Path, raw: &Raw) -> io::Result<()> {
    let codes = match &raw.data {
        RawData::U8(v) => Codes::U8(v),
        RawData::U16(v) => Codes::U16(v),
        RawData::Float(_) => {
            let problem = format!("{}: floating-point numbers do not fit into PNG; save codes", path.display());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, problem));
        }
    };
    write_png(path, codes, raw.width, raw.height, raw.channels)
}

/// A sensor's codes, row by row, channels interleaved.
#[derive(Clone, Copy)]
pub(crate) enum Codes<'a> {
    /// Of at most 8 bits.
    U8(&'a [u8]),
    /// Of 9 to 16 bits.
    U16(&'a [u16]),
}

/// Writes codes as they are, `height × width × channels` of them: gray for one channel, RGB for three.
pub(crate) fn write_png(path: &Path, codes: Codes<'_>, width: usize, height: usize, channels: usize) -> io::Result<()> {
    // Captures hardly compress: the fast setting costs a few percent of size and saves most of the time.
    write_atomic(path, |w: &mut dyn Write| encode(w, codes, [width, height], channels, Compression::Fast))
}

fn encode(
    w: impl Write,
    codes: Codes<'_>,
    [width, height]: [usize; 2],
    channels: usize,
    compression: Compression,
) -> io::Result<()> {
    let n = match codes {
        Codes::U8(v) => v.len(),
        Codes::U16(v) => v.len(),
    };
    assert_eq!(n, width * height * channels, "picture data of another size");
    let size = |n: usize| u32::try_from(n).map_err(|_| io::Error::other("too large for a PNG file"));
    let mut encoder = Encoder::new(w, size(width)?, size(height)?);
    encoder.set_color(if channels == 3 { ColorType::Rgb } else { ColorType::Grayscale });
    encoder.set_compression(compression);
    encoder.set_filter(Filter::Adaptive);
    let io_error = |e| match e {
        EncodingError::IoError(e) => e,
        other => io::Error::other(other),
    };
    match codes {
        Codes::U8(v) => encoder.write_header().and_then(|mut w| w.write_image_data(v)).map_err(io_error),
        Codes::U16(v) => {
            encoder.set_depth(BitDepth::Sixteen);
            // PNG is big-endian.
            let bytes: Vec<u8> = v.iter().flat_map(|c| c.to_be_bytes()).collect();
            encoder.write_header().and_then(|mut w| w.write_image_data(&bytes)).map_err(io_error)
        }
    }
}
