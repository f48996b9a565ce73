//! JPEG, through the `zune-jpeg` crate.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::error::ImageFileError;
use super::file::File;
use super::raw::{Raw, RawData};

pub(super) fn decode(file: &File<'_>) -> Result<Raw, ImageFileError> {
    let options = |space| DecoderOptions::default().jpeg_set_out_colorspace(space);
    let reader = |space| JpegDecoder::new_with_options(ZCursor::new(file.bytes), options(space));
    let mut headers = reader(ColorSpace::RGB);
    headers.decode_headers().map_err(|e| file.damaged(e))?;
    let info = headers.info().ok_or_else(|| file.damaged("it has no header"))?;
    let (width, height) = (usize::from(info.width), usize::from(info.height));
    file.check_size(width, height)?;
    let (space, channels) = match headers.input_colorspace() {
        Some(ColorSpace::Luma) => (ColorSpace::Luma, 1),
        Some(ColorSpace::YCbCr | ColorSpace::RGB) => (ColorSpace::RGB, 3),
        _ => return Err(file.kind("is neither gray nor of three colors", "save it as an RGB JPEG, or as PNG")),
    };
    let codes = reader(space).decode().map_err(|e| file.damaged(e))?;
    file.raw(width, height, channels, RawData::U8(codes))
}
