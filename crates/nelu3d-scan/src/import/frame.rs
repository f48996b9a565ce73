//! One frame: its codes, and what its file says about the sensor.

use std::path::{Path, PathBuf};

use super::facts::Facts;
use super::{ImportError, dng};
use crate::image::{ImageFileError, Raw, RawData, decode_bytes, read_image_file};

/// The format of the file of a recording's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A PNG file, which a rig can hold as it is.
    Png,
    /// A TIFF file, which a rig can hold as it is.
    Tiff,
    /// A DNG file, which becomes one of the others.
    Dng,
}

/// A frame of a recording that has been read.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The file that it was read from.
    pub path: PathBuf,
    /// The format of that file.
    pub format: Format,
    /// The sensor's codes.
    pub raw: Raw,
    /// What the file says about the sensor.
    pub facts: Facts,
}

/// Reads a frame of this (width, height): PNG, TIFF, or raw DNG, told by its content.
///
/// # Errors
///
/// The file cannot be read, is damaged, of another size, or of another format.
pub fn read(path: &Path, size: (usize, usize)) -> Result<Frame, ImageFileError> {
    let bytes = read_image_file(path, Some(size))?;
    let (format, raw, facts) = if bytes.starts_with(b"\x89PNG") {
        (Format::Png, decode_bytes(path, &bytes, Some(size))?, Facts::default())
    } else if dng::is_raw(path, &bytes) {
        let (raw, facts) = dng::decode(path, bytes, size)?;
        (Format::Dng, raw, facts)
    } else {
        (Format::Tiff, decode_bytes(path, &bytes, Some(size))?, Facts::default())
    };
    Ok(Frame { path: path.to_path_buf(), format, raw, facts })
}

/// The properties that all frames of a recording share.
#[derive(Clone, Debug)]
pub(super) struct Kind {
    path: PathBuf,
    format: Format,
    depth: crate::image::Depth,
    channels: usize,
    facts: Facts,
}

impl Kind {
    pub(super) fn of(frame: &Frame) -> Self {
        let raw = &frame.raw;
        let (path, facts) = (frame.path.clone(), frame.facts.clone());
        Self { path, format: frame.format, depth: raw.depth(), channels: raw.channels, facts }
    }

    /// Fails for a frame of another kind.
    pub(super) fn check(&self, frame: &Frame) -> Result<(), ImportError> {
        let first = super::frames::file_name(&self.path);
        let raw = &frame.raw;
        let problem = if raw.depth() != self.depth {
            format!("is {}, but {first} is {}", raw.depth(), self.depth)
        } else if raw.channels != self.channels {
            format!("has {} channels, but {first} has {}", raw.channels, self.channels)
        } else if frame.format != self.format {
            format!("is {:?}, but {first} is {:?}", frame.format, self.format)
        } else if frame.facts != self.facts {
            format!("states another color filter, black or white level than {first}")
        } else {
            return Ok(());
        };
        Err(ImportError::unfit(&frame.path, problem, "import recordings of different settings one by one"))
    }
}

/// Mean codes of several images of one kind, rounded to whole codes.
pub(super) struct Mean {
    sums: Vec<u64>,
    count: u64,
}

impl Mean {
    pub(super) fn new() -> Self {
        Self { sums: Vec::new(), count: 0 }
    }

    /// Adds an image of whole codes.
    pub(super) fn add(&mut self, frame: &Frame) -> Result<(), ImportError> {
        let codes: Box<dyn Iterator<Item = u64>> = match &frame.raw.data {
            RawData::U8(v) => Box::new(v.iter().map(|&c| u64::from(c))),
            RawData::U16(v) => Box::new(v.iter().map(|&c| u64::from(c))),
            RawData::Float(_) => {
                let problem = "holds floating-point numbers, which are not averaged here";
                return Err(ImportError::unfit(&frame.path, problem, "average it with the program that wrote it"));
            }
        };
        if self.sums.is_empty() {
            self.sums = codes.collect();
        } else {
            self.sums.iter_mut().zip(codes).for_each(|(sum, code)| *sum += code);
        }
        self.count += 1;
        Ok(())
    }

    /// Returns the mean, as an image like `like`.
    pub(super) fn finish(self, like: &Raw) -> Raw {
        let mean = |sum: u64| (sum + self.count / 2) / self.count;
        let data = match like.data {
            RawData::U8(_) => RawData::U8(self.sums.iter().map(|&s| mean(s) as u8).collect()),
            _ => RawData::U16(self.sums.iter().map(|&s| mean(s) as u16).collect()),
        };
        Raw { data, ..*like }
    }
}
