//! Writing images into the rig: as they are where possible, with the same codes otherwise.

use std::io::{self, Cursor};
use std::path::Path;

use ::tiff::encoder::{TiffEncoder, colortype};

use super::frame::{Format, Frame};
use super::frames::ending;
use crate::image::{Codes, Raw, RawData, write_png};
use crate::output::{link_or_copy, write_atomic};

/// Puts a frame at `path`: the same file if that has the right format, its codes in a new one otherwise.
pub(super) fn put(frame: &Frame, path: &Path) -> io::Result<()> {
    let same = match frame.format {
        Format::Png => ending(path) == "png",
        Format::Tiff => ending(path).starts_with("tif"),
        Format::Dng => false,
    };
    if same { link_or_copy(&frame.path, path) } else { write(&frame.raw, path) }
}

/// Writes a sensor's codes as they are: as TIFF where the name ends in `.tif` or `.tiff`, else as PNG.
///
/// # Errors
///
/// The file cannot be written, or floating-point numbers would have to go into a PNG, which holds none.
pub fn write(raw: &Raw, path: &Path) -> io::Result<()> {
    let Raw { width, height, channels, data } = raw;
    if ending(path).starts_with("tif") {
        return write_tiff(raw, path);
    }
    match data {
        RawData::U8(v) => write_png(path, Codes::U8(v), *width, *height, *channels),
        RawData::U16(v) => write_png(path, Codes::U16(v), *width, *height, *channels),
        RawData::Float(_) => {
            let problem = "floating-point numbers do not fit into PNG; call the rig's images .tiff in rig.toml";
            Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{}: {problem}", path.display())))
        }
    }
}

fn write_tiff(raw: &Raw, path: &Path) -> io::Result<()> {
    let size = |n: usize| u32::try_from(n).map_err(io::Error::other);
    let (w, h) = (size(raw.width)?, size(raw.height)?);
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).map_err(io::Error::other)?;
    match (&raw.data, raw.channels) {
        (RawData::U8(v), 3) => encoder.write_image::<colortype::RGB8>(w, h, v),
        (RawData::U8(v), _) => encoder.write_image::<colortype::Gray8>(w, h, v),
        (RawData::U16(v), 3) => encoder.write_image::<colortype::RGB16>(w, h, v),
        (RawData::U16(v), _) => encoder.write_image::<colortype::Gray16>(w, h, v),
        (RawData::Float(v), 3) => encoder.write_image::<colortype::RGB32Float>(w, h, v),
        (RawData::Float(v), _) => encoder.write_image::<colortype::Gray32Float>(w, h, v),
    }
    .map_err(io::Error::other)?;
    write_atomic(path, |w| w.write_all(file.get_ref()))
}
