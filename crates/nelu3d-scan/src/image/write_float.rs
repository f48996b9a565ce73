//! Maps of 32-bit floats as pictures that other programs open: TIFF and OpenEXR.

use std::io::{self, Cursor};
use std::path::Path;

use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage};
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::Gray32Float;

use crate::output::write_atomic;

/// Writes a map, `height × width`, as a TIFF file of one 32-bit float a pixel. NaN stays NaN.
///
/// # Errors
///
/// The file cannot be written; the message names it.
///
/// # Panics
///
/// If the map has another size.
pub fn write_tiff_f32(path: &Path, width: usize, height: usize, map: &[f32]) -> io::Result<()> {
    assert_eq!(map.len(), width * height, "a map of {width} × {height} pixels");
    let failed = |e: tiff::TiffError| io::Error::other(format!("{}: cannot be written: {e}", path.display()));
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).map_err(failed)?;
    encoder.write_image::<Gray32Float>(width as u32, height as u32, map).map_err(failed)?;
    write_atomic(path, |w| w.write_all(bytes.get_ref()))
}

/// Writes a map, `height × width`, as an OpenEXR file of one channel of 32-bit floats, without loss. NaN stays NaN.
///
/// # Errors
///
/// The file cannot be written; the message names it.
///
/// # Panics
///
/// If the map has another size.
pub fn write_exr_f32(path: &Path, width: usize, height: usize, channel: &str, map: &[f32]) -> io::Result<()> {
    assert_eq!(map.len(), width * height, "a map of {width} × {height} pixels");
    let pixel = |at: Vec2<usize>| (map[at.y() * width + at.x()],);
    let channels = SpecificChannels::build().with_channel(channel).with_pixel_fn(pixel);
    let image = Image::from_channels((width, height), channels);
    let mut bytes = Cursor::new(Vec::new());
    let failed = |e: exr::error::Error| io::Error::other(format!("{}: cannot be written: {e}", path.display()));
    image.write().to_buffered(&mut bytes).map_err(failed)?;
    write_atomic(path, |w| w.write_all(bytes.get_ref()))
}
