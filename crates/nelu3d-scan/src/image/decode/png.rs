//! PNG, through the `image` crate.

use std::io::Cursor;

use ::image::codecs::png::PngDecoder;
use ::image::{ColorType, DynamicImage, ImageDecoder, Limits};

use super::error::ImageFileError;
use super::file::File;
use super::raw::{Raw, RawData};

pub(super) fn decode(file: &File<'_>) -> Result<Raw, ImageFileError> {
    // The size is checked before any pixel is allocated, which makes the decoder's own limit needless.
    let decoder = PngDecoder::with_limits(Cursor::new(file.bytes), Limits::no_limits()).map_err(|e| file.damaged(e))?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    file.check_size(width, height)?;
    let channels = match decoder.color_type() {
        ColorType::L8 | ColorType::L16 => 1,
        ColorType::Rgb8 | ColorType::Rgb16 => 3,
        _ => return Err(file.alpha()),
    };
    let data = match DynamicImage::from_decoder(decoder).map_err(|e| file.damaged(e))? {
        DynamicImage::ImageLuma8(i) => RawData::U8(i.into_raw()),
        DynamicImage::ImageRgb8(i) => RawData::U8(i.into_raw()),
        DynamicImage::ImageLuma16(i) => RawData::U16(i.into_raw()),
        DynamicImage::ImageRgb16(i) => RawData::U16(i.into_raw()),
        other => {
            return Err(file.kind(format!("holds {:?} pixels", other.color()), "save it as 8 or 16-bit gray or RGB"));
        }
    };
    file.raw(width, height, channels, data)
}
