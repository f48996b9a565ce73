//! TIFF, through the `tiff` crate (the `image` crate has no gray floats).

use std::io::Cursor;

use ::tiff::ColorType;
use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::tags::Tag;

use super::error::ImageFileError;
use super::file::File;
use super::raw::{Raw, RawData};

/// Bytes of a pixel of three 64-bit numbers: more than any capture has.
const MAX_BYTES_PER_PIXEL: usize = 24;

pub(super) fn decode(file: &File<'_>) -> Result<Raw, ImageFileError> {
    let mut decoder = Decoder::new(Cursor::new(file.bytes)).map_err(|e| file.damaged(e))?;
    let (width, height) = decoder.dimensions().map_err(|e| file.damaged(e))?;
    let (width, height) = (width as usize, height as usize);
    file.check_size(width, height)?;
    // The size is good, so any image of it may be read, but no list that a damaged tag claims to be longer.
    let mut limits = Limits::default();
    limits.decoding_buffer_size = limits.decoding_buffer_size.max(MAX_BYTES_PER_PIXEL * width * height);
    limits.intermediate_buffer_size = limits.intermediate_buffer_size.max(file.bytes.len());
    let mut decoder = decoder.with_limits(limits);
    let color = decoder.colortype().map_err(|e| file.damaged(e))?;
    let bytes_per_pixel = (usize::from(color.bit_depth()) * usize::from(color.num_samples())).div_ceil(8);
    file.check_decoded((width * height).saturating_mul(bytes_per_pixel))?;
    let channels = match color {
        ColorType::Gray(_) => 1,
        ColorType::RGB(_) => 3,
        ColorType::GrayA(_) | ColorType::RGBA(_) => return Err(file.alpha()),
        other => return Err(file.kind(format!("holds {other:?} pixels"), "save it as gray or RGB")),
    };
    let planar = matches!(decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration), Ok(Some(2)));
    let n = width * height;
    let data = match decoder.read_image().map_err(|e| file.damaged(e))? {
        DecodingResult::U8(v) => RawData::U8(interleaved(v, n, planar)),
        DecodingResult::U16(v) => RawData::U16(interleaved(v, n, planar)),
        DecodingResult::F16(v) => RawData::Float(interleaved(v.into_iter().map(f32::from).collect(), n, planar)),
        DecodingResult::F32(v) => RawData::Float(interleaved(v, n, planar)),
        _ => {
            return Err(file.kind("holds numbers of an unusual type", "save it with 8 or 16 bits, or as 32-bit floats"));
        }
    };
    file.raw(width, height, channels, data)
}

/// Interleaves `n` pixels that are stored plane after plane.
fn interleaved<T: Copy>(v: Vec<T>, n: usize, planar: bool) -> Vec<T> {
    if !planar || n == 0 || v.len() != 3 * n {
        return v;
    }
    (0..n).flat_map(|i| [v[i], v[n + i], v[2 * n + i]]).collect()
}
