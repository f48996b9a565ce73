//! From a file to the sensor's codes. The format is told by the file's first bytes, not by its name.

mod error;
mod exr;
mod file;
mod jpeg;
mod link;
mod png;
mod raw;
mod tiff;

use std::io;
use std::path::{Path, PathBuf};

pub use error::ImageFileError;
pub use raw::{Depth, Raw, RawData};

use self::file::File;
use crate::image::{Channels, Image};
use crate::input::{MAX_DATA, read_file};

/// Decodes a PNG, TIFF, OpenEXR or JPEG file. With `size` = (width, height) a file of another size is refused before
/// its pixels are read.
///
/// # Errors
///
/// The file is missing, unreadable, of another format or size, damaged, or of a kind no capture has (alpha, palette of
/// more than 16 bits, …). Every message names the file.
pub fn decode(path: &Path, size: Option<(usize, usize)>) -> Result<Raw, ImageFileError> {
    decode_bytes(path, &read_image_file(path, size)?, size)
}

/// Returns the file that holds the image: the target of a symbolic link that became a text file, else `path` itself.
///
/// # Errors
///
/// It is such a link, and there is no such file.
pub(crate) fn follow(path: &Path) -> Result<PathBuf, ImageFileError> {
    let Some(target) = link::target(path) else { return Ok(path.to_path_buf()) };
    if target.is_file() {
        return Ok(target);
    }
    Err(ImageFileError::Kind {
        path: path.to_path_buf(),
        problem: format!("it is a link that was copied as text, to {}, which is not there", target.display()),
        remedy: "copy the image itself".into(),
    })
}

/// Reads the bytes of an image file. With `size` = (width, height), no more than such an image can have.
///
/// # Errors
///
/// The file is missing, unreadable, no regular file, or too large.
pub(crate) fn read_image_file(path: &Path, size: Option<(usize, usize)>) -> Result<Vec<u8>, ImageFileError> {
    /// Bytes of a pixel of three 64-bit numbers: more than any capture has.
    const MAX_BYTES_PER_PIXEL: usize = 24;
    /// What a camera may write beside the pixels: previews, notes.
    const MAX_BESIDE: usize = 256 << 20;
    let max = size.map_or(MAX_DATA, |(w, h)| (w.saturating_mul(h) * MAX_BYTES_PER_PIXEL + MAX_BESIDE) as u64);
    read_file(&follow(path)?, max.min(MAX_DATA)).map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => ImageFileError::Missing { path: path.to_path_buf() },
        _ => ImageFileError::Io { path: path.to_path_buf(), source },
    })
}

/// Decodes the content of a file, as [`decode()`] does; `path` is only for messages.
///
/// # Errors
///
/// As [`decode()`], but for what concerns the file itself.
pub fn decode_bytes(path: &Path, bytes: &[u8], size: Option<(usize, usize)>) -> Result<Raw, ImageFileError> {
    let file = File { path, bytes, size };
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => png::decode(&file),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => tiff::decode(&file),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr::decode(&file),
        [0xff, 0xd8, 0xff, ..] => jpeg::decode(&file),
        [] => Err(file.damaged("it is empty")),
        _ => Err(ImageFileError::Format { path: path.to_path_buf() }),
    }
}

/// Reads a picture that no sensor took (a projected pattern, say): its full scale is that of its depth, so codes become
/// code / 255 or code / 65535, and floats stay as they are.
///
/// # Errors
///
/// As [`decode()`], or a value that is not finite.
pub fn read_any(path: &Path) -> Result<Image, ImageFileError> {
    let raw = decode(path, None)?;
    let channels = if raw.channels == 3 { Channels::Rgb } else { Channels::Mono };
    raw.linearize(path, channels, 0.0, raw.depth().max().unwrap_or(1.0))
}
