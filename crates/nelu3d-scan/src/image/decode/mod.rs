//! From a file to the sensor's codes. The format is told by the file's first bytes, not by its name.

mod exr;
mod png;
mod tiff;

use std::io;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::{Channels, Image, demosaic};

/// Why an image file could not be used.
#[derive(Debug, thiserror::Error)]
pub enum ImageFileError {
    /// The file is missing.
    #[error("{}: there is no such image; capture it, or correct the name in rig.toml", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// The operating system would not let it be read.
    #[error("{}: cannot be read: {source}; check its permissions and the disk", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Not PNG, TIFF or EXR.
    #[error("{}: is neither PNG, TIFF nor OpenEXR; save it as one of them, without loss", path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// Truncated or damaged.
    #[error("{}: cannot be decoded ({reason}): the file is truncated or damaged; copy or capture it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// A valid image of a kind that no capture has.
    #[error("{}: {problem}; {remedy}", path.display())]
    Kind {
        /// The file.
        path: PathBuf,
        /// What it is.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
    /// Another size than the camera's.
    #[error(
        "{}: is {found_width}x{found_height} pixels, but its intrinsics say {width}x{height}; \
         use the images that belong to these intrinsics, or correct the intrinsics", path.display()
    )]
    Size {
        /// The file.
        path: PathBuf,
        /// Width found, px.
        found_width: usize,
        /// Height found, px.
        found_height: usize,
        /// Width expected, px.
        width: usize,
        /// Height expected, px.
        height: usize,
    },
}

impl ImageFileError {
    /// The file.
    pub fn path(&self) -> &Path {
        match self {
            ImageFileError::Missing { path }
            | ImageFileError::Io { path, .. }
            | ImageFileError::Format { path }
            | ImageFileError::Damaged { path, .. }
            | ImageFileError::Kind { path, .. }
            | ImageFileError::Size { path, .. } => path,
        }
    }
}

/// What a value is stored as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// 8-bit codes.
    U8,
    /// 16-bit codes.
    U16,
    /// 16 or 32-bit floats.
    Float,
}

impl Depth {
    /// The largest code, or `None` for floats.
    pub fn max(self) -> Option<f64> {
        match self {
            Depth::U8 => Some(255.0),
            Depth::U16 => Some(65535.0),
            Depth::Float => None,
        }
    }
}

impl std::fmt::Display for Depth {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Depth::U8 => "8-bit",
            Depth::U16 => "16-bit",
            Depth::Float => "floating-point",
        })
    }
}

/// The values of a [`Raw`] image, `height × width × channels`, row by row.
#[derive(Clone, Debug, PartialEq)]
pub enum RawData {
    /// 8-bit codes.
    U8(Vec<u8>),
    /// 16-bit codes.
    U16(Vec<u16>),
    /// Floats.
    Float(Vec<f32>),
}

/// A decoded file: the sensor's codes as they were stored.
#[derive(Clone, Debug, PartialEq)]
pub struct Raw {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// 1 or 3.
    pub channels: usize,
    /// The codes.
    pub data: RawData,
}

impl Raw {
    /// What a value is stored as.
    pub fn depth(&self) -> Depth {
        match self.data {
            RawData::U8(_) => Depth::U8,
            RawData::U16(_) => Depth::U16,
            RawData::Float(_) => Depth::Float,
        }
    }

    /// The linear image: `(code − black_level) / (saturation − black_level)`, demosaiced for a mosaic. `path` is only for
    /// messages.
    ///
    /// # Errors
    ///
    /// The file has another number of channels than the sensor, a saturation no code of this depth can reach, or a value
    /// that is not a number.
    pub fn linearize(
        &self,
        path: &Path,
        channels: Channels,
        black_level: f64,
        saturation: f64,
    ) -> Result<Image, ImageFileError> {
        self.check_kind(path, channels, saturation)?;
        let (b, s) = (black_level, 1.0 / (saturation - black_level));
        let linear = |code: f64| ((code - b) * s) as f32;
        let data: Vec<f32> = match &self.data {
            RawData::U8(v) => {
                let table: Vec<f32> = (0..=255u8).map(|c| linear(f64::from(c))).collect();
                v.par_iter().map(|&c| table[usize::from(c)]).collect()
            }
            RawData::U16(v) => v.par_iter().map(|&c| linear(f64::from(c))).collect(),
            RawData::Float(v) => v.par_iter().map(|&c| linear(f64::from(c))).collect(),
        };
        let image = Image { width: self.width, height: self.height, channels: self.channels, data };
        Ok(match channels {
            Channels::Bayer(cell) => demosaic(&image, cell),
            Channels::Mono | Channels::Rgb => image,
        })
    }

    /// Complains about what [`Raw::linearize`] cannot use.
    pub(crate) fn check_kind(&self, path: &Path, channels: Channels, saturation: f64) -> Result<(), ImageFileError> {
        let kind = |problem: String, remedy: String| ImageFileError::Kind { path: path.to_path_buf(), problem, remedy };
        if self.channels != channels.in_file() {
            let name = channels.name();
            return Err(if self.channels == 3 {
                let remedy = if self.is_gray() {
                    "its three channels are equal: save it with one (ImageMagick: convert in.png -colorspace Gray out.png)"
                } else {
                    "set camera.channels = \"rgb\" if this is a color camera, or save the sensor's single channel"
                };
                kind(format!("has three channels, but rig.toml says camera.channels = \"{name}\""), remedy.into())
            } else {
                let remedy =
                    "set camera.channels = \"mono\" (or the bayer-… layout of a raw mosaic), or save color images";
                kind("has one channel, but rig.toml says camera.channels = \"rgb\"".into(), remedy.into())
            });
        }
        if let Some(max) = self.depth().max().filter(|&max| saturation > max) {
            return Err(kind(
                format!("is {}, so it never reaches the saturation of {saturation} that rig.toml states", self.depth()),
                format!("save it with the sensor's full depth, or set camera.saturation to at most {max}"),
            ));
        }
        if let RawData::Float(v) = &self.data
            && let Some(i) = v.iter().position(|c| !c.is_finite())
        {
            let (x, y) = (i / self.channels % self.width, i / self.channels / self.width);
            return Err(kind(
                format!("holds {} at pixel ({x}, {y})", v[i]),
                "write finite values only: a dark pixel is the black level, a clipped one the saturation".into(),
            ));
        }
        Ok(())
    }

    /// Whether a three-channel image is really gray.
    fn is_gray(&self) -> bool {
        fn gray<T: PartialEq>(v: &[T]) -> bool {
            v.chunks_exact(3).all(|p| p[0] == p[1] && p[1] == p[2])
        }
        match &self.data {
            RawData::U8(v) => gray(v),
            RawData::U16(v) => gray(v),
            RawData::Float(v) => gray(v),
        }
    }
}

/// Decodes a PNG, TIFF or OpenEXR file. With `size` = (width, height) a file of another size is refused before its
/// pixels are read.
///
/// # Errors
///
/// The file is missing, unreadable, of another format or size, damaged, or of a kind no capture has (alpha, palette of
/// more than 16 bits, …). Every message names the file.
pub fn decode(path: &Path, size: Option<(usize, usize)>) -> Result<Raw, ImageFileError> {
    let bytes = std::fs::read(path).map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => ImageFileError::Missing { path: path.to_path_buf() },
        _ => ImageFileError::Io { path: path.to_path_buf(), source },
    })?;
    decode_bytes(path, &bytes, size)
}

/// [`decode()`] of a file's content; `path` is only for messages.
pub(crate) fn decode_bytes(path: &Path, bytes: &[u8], size: Option<(usize, usize)>) -> Result<Raw, ImageFileError> {
    let file = File { path, bytes, size };
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => png::decode(&file),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => tiff::decode(&file),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr::decode(&file),
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

/// A file being decoded: its bytes and how to complain about it.
struct File<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    size: Option<(usize, usize)>,
}

impl File<'_> {
    fn damaged(&self, reason: impl std::fmt::Display) -> ImageFileError {
        ImageFileError::Damaged { path: self.path.to_path_buf(), reason: reason.to_string() }
    }

    fn kind(&self, problem: impl Into<String>, remedy: impl Into<String>) -> ImageFileError {
        ImageFileError::Kind { path: self.path.to_path_buf(), problem: problem.into(), remedy: remedy.into() }
    }

    fn alpha(&self) -> ImageFileError {
        self.kind("has an alpha channel", "save it without transparency")
    }

    fn check_size(&self, found_width: usize, found_height: usize) -> Result<(), ImageFileError> {
        match self.size {
            Some((width, height)) if (width, height) != (found_width, found_height) => {
                Err(ImageFileError::Size { path: self.path.to_path_buf(), found_width, found_height, width, height })
            }
            _ if found_width == 0 || found_height == 0 => Err(self.damaged("it has no pixels")),
            // A damaged header must not make a decoder ask for all memory there is.
            _ if found_width.saturating_mul(found_height) > 1 << 28 => {
                Err(self.damaged(format_args!("it claims {found_width}x{found_height} pixels")))
            }
            _ => Ok(()),
        }
    }

    fn raw(&self, width: usize, height: usize, channels: usize, data: RawData) -> Result<Raw, ImageFileError> {
        let len = match &data {
            RawData::U8(v) => v.len(),
            RawData::U16(v) => v.len(),
            RawData::Float(v) => v.len(),
        };
        if len != width * height * channels {
            return Err(self.damaged("it holds another number of pixels than it says"));
        }
        Ok(Raw { width, height, channels, data })
    }
}
