//! PNG, through the `png` crate.

use std::io::{BufRead, Cursor, Seek};

use ::png::{BitDepth, ColorType, Decoder, DecodingError, Limits, Reader, Transformations};

use super::error::ImageFileError;
use super::file::File;
use super::raw::{Raw, RawData};

pub(super) fn decode(file: &File<'_>) -> Result<Raw, ImageFileError> {
    // The size is checked before any pixel is allocated, which makes the decoder's own limit needless.
    let mut decoder = Decoder::new_with_limits(Cursor::new(file.bytes), Limits { bytes: usize::MAX });
    // What stands beside the pixels is of no use here, and a color profile or a text of a kilobyte can unpack to a
    // gigabyte.
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    // Palettes become colors, and codes of fewer than eight bits are stretched to eight.
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|e| file.damaged(e))?;
    let (width, height) = reader.info().size();
    let (width, height) = (width as usize, height as usize);
    file.check_size(width, height)?;
    // The crate takes the rest of such a palette for a color, and panics.
    if reader.info().palette.as_ref().is_some_and(|p| p.len() % 3 != 0) {
        return Err(file.damaged("its palette ends within a color"));
    }
    let (color, depth) = reader.output_color_type();
    let channels = match color {
        ColorType::Grayscale => 1,
        ColorType::Rgb => 3,
        ColorType::GrayscaleAlpha | ColorType::Rgba | ColorType::Indexed => return Err(file.alpha()),
    };
    let size = reader.output_buffer_size().ok_or_else(|| file.damaged("it is too large for this machine"))?;
    file.check_decoded(size)?;
    let data = match depth {
        BitDepth::Sixteen => RawData::U16(codes(&mut reader, size).map_err(|e| file.damaged(e))?),
        _ => {
            let mut bytes = vec![0; size];
            reader.next_frame(&mut bytes).map_err(|e| file.damaged(e))?;
            RawData::U8(bytes)
        }
    };
    file.raw(width, height, channels, data)
}

/// Bytes from which an image is decoded row by row: so large a buffer for all of them is memory that takes longer to get
/// than to fill.
const LARGE: usize = 1 << 24;

/// Returns the 16-bit codes of an image of `size` bytes.
fn codes(reader: &mut Reader<impl BufRead + Seek>, size: usize) -> Result<Vec<u16>, DecodingError> {
    let info = reader.info();
    if info.interlaced || size < LARGE {
        let mut bytes = vec![0; size];
        reader.next_frame(&mut bytes)?;
        return Ok(bytes.as_chunks().0.iter().map(|c| u16::from_be_bytes(*c)).collect());
    }
    let mut row = vec![0; size / info.height as usize];
    let mut codes = Vec::with_capacity(size / 2);
    while reader.read_row(&mut row)?.is_some() {
        codes.extend(row.as_chunks().0.iter().map(|c| u16::from_be_bytes(*c)));
    }
    Ok(codes)
}
