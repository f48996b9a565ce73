//! Uncompressed raw images of one channel in DNG and CinemaDNG files (Adobe, "Digital Negative (DNG) Specification",
//! version 1.6; TIFF 6.0), as high-speed and cinema cameras record them: 8 to 16 bits, packed or not, in strips or
//! tiles, with the facts about the sensor that go with them.
//!
//! Tags are read by the `tiff` crate; it refuses to decode images of this kind itself.

mod tags;
mod unpack;

use std::path::Path;

use self::tags::{Directory, Tags};
use super::facts::Facts;
use super::frames::ending;
use crate::image::{Channels, ImageFileError, Raw, RawData};

/// PhotometricInterpretation of gray images, as mono cameras write them.
const BLACK_IS_ZERO: u64 = 1;
/// PhotometricInterpretation of a color filter array.
const CFA: u64 = 32803;
/// PhotometricInterpretation of an image without a filter.
const LINEAR_RAW: u64 = 34892;

/// Returns whether the file is one for [`decode`]: its name or its content says so. It may be damaged.
pub(super) fn is_raw(path: &Path, bytes: &[u8]) -> bool {
    if ending(path) == "dng" {
        return true;
    }
    // In TIFF files the first directory is the image.
    let Ok(mut tags) = Tags::new(bytes.to_vec()) else { return false };
    let Ok(dir) = tags.first() else { return false };
    let photometric = tags.number(&dir, tags::PHOTOMETRIC).ok().flatten();
    let bits = tags.number(&dir, tags::BITS_PER_SAMPLE).ok().flatten();
    matches!(photometric, Some(CFA | LINEAR_RAW)) || matches!(bits, Some(10 | 12 | 14))
}

/// Decodes the content of a raw DNG file of this (width, height); `path` is only for messages. Returns its codes, and
/// what the file says about the sensor.
///
/// # Errors
///
/// The file is damaged, compressed, of another size, or no raw image.
pub fn decode(path: &Path, bytes: Vec<u8>, size: (usize, usize)) -> Result<(Raw, Facts), ImageFileError> {
    let file = File { path, size };
    if bytes.is_empty() {
        return Err(file.damaged("it is empty"));
    }
    if !matches!(bytes[..], [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..]) {
        return Err(ImageFileError::Format { path: path.to_path_buf() });
    }
    let mut tags = Tags::new(bytes).map_err(|e| file.damaged(e))?;
    let dir = raw_directory(&mut tags).map_err(|e| file.damaged(e))?;
    Image { file, tags: &mut tags, dir: &dir }.decode()
}

/// Returns the directory of the raw image: the first that is no preview (NewSubfileType, bit 0), children included.
fn raw_directory(tags: &mut Tags) -> Result<Directory, String> {
    let first = tags.first()?;
    let children = tags.children(&first)?;
    for dir in std::iter::once(first).chain(children) {
        if tags.number(&dir, tags::NEW_SUBFILE_TYPE)?.unwrap_or(0) == 0 {
            return Ok(dir);
        }
    }
    Err("it has only previews".into())
}

/// The file that is decoded, for messages.
struct File<'a> {
    path: &'a Path,
    size: (usize, usize),
}

impl File<'_> {
    fn damaged(&self, reason: impl std::fmt::Display) -> ImageFileError {
        ImageFileError::Damaged { path: self.path.to_path_buf(), reason: reason.to_string() }
    }

    fn kind(&self, problem: impl Into<String>, remedy: impl Into<String>) -> ImageFileError {
        ImageFileError::Kind { path: self.path.to_path_buf(), problem: problem.into(), remedy: remedy.into() }
    }
}

/// One raw image being decoded.
struct Image<'a> {
    file: File<'a>,
    tags: &'a mut Tags,
    dir: &'a Directory,
}

impl Image<'_> {
    fn decode(mut self) -> Result<(Raw, Facts), ImageFileError> {
        let (width, height) = (self.need(tags::WIDTH)?, self.need(tags::HEIGHT)?);
        if width == 0 || height == 0 || width.saturating_mul(height) > 1 << 28 {
            return Err(self.file.damaged(format_args!("it claims {width}x{height} pixels")));
        }
        let photometric = self.number(tags::PHOTOMETRIC)?;
        let channels = self.channels(photometric)?;
        self.check_coding()?;
        let bits = self.number(tags::BITS_PER_SAMPLE)?.unwrap_or(1);
        if !(8..=16).contains(&bits) {
            return Err(self.file.kind(format!("has {bits} bits a pixel"), "record or convert it with 8 to 16 bits"));
        }
        // What is not compressed takes its place: a damaged header must not make us ask for more.
        if (width * height).saturating_mul(bits as usize) / 8 > self.tags.bytes().len() {
            return Err(self.file.damaged(format_args!("it claims {width}x{height} pixels, which it cannot hold")));
        }
        let area = self.active_area(width, height)?;
        let (found_width, found_height) = (area[3] - area[1], area[2] - area[0]);
        let (want_width, want_height) = self.file.size;
        if (found_width, found_height) != (want_width, want_height) {
            return Err(ImageFileError::Size {
                path: self.file.path.to_path_buf(),
                found_width,
                found_height,
                width: want_width,
                height: want_height,
            });
        }
        let chunks = self.chunks(width, height)?;
        let bytes = self.tags.bytes();
        let big_endian = bytes.starts_with(b"MM");
        let mut codes = vec![0; width * height];
        for chunk in &chunks {
            unpack::unpack(bytes, chunk, bits as usize, big_endian, width, &mut codes)
                .map_err(|e| self.file.damaged(e))?;
        }
        self.linearize(&mut codes)?;
        let data = if (found_width, found_height) == (width, height) {
            codes
        } else {
            (area[0]..area[2]).flat_map(|y| &codes[y * width + area[1]..y * width + area[3]]).copied().collect()
        };
        let facts = Facts {
            channels: Some(channels),
            black_level: self.black_level()?,
            white_level: self.numbers(tags::WHITE_LEVEL)?.first().copied().filter(|w| w.is_finite() && *w > 0.0),
        };
        Ok((Raw { width: found_width, height: found_height, channels: 1, data: RawData::U16(data) }, facts))
    }

    /// Returns the color filter, whose pattern begins at the top left of the active area.
    fn channels(&mut self, photometric: Option<u64>) -> Result<Channels, ImageFileError> {
        let samples = self.number(tags::SAMPLES_PER_PIXEL)?.unwrap_or(1);
        let remedy = "record raw frames, or save them as 8 or 16-bit TIFF";
        if samples != 1 {
            return Err(self.file.kind(format!("has {samples} values a pixel, so it is no raw image"), remedy));
        }
        match photometric {
            Some(BLACK_IS_ZERO | LINEAR_RAW) => Ok(Channels::Mono),
            Some(CFA) => {
                let size = self.numbers(tags::CFA_REPEAT)?;
                let cell = self.numbers(tags::CFA_PATTERN)?;
                let found = Channels::ALL.into_iter().find(|c| match c {
                    Channels::Bayer(b) => size == [2.0, 2.0] && b.map(f64::from)[..] == cell[..],
                    _ => false,
                });
                let problem = || format!("has the color filter {cell:?} of size {size:?}, which is no Bayer pattern");
                found.ok_or_else(|| self.file.kind(problem(), "develop it, and save it as 8 or 16-bit TIFF"))
            }
            other => {
                let other = other.map_or("none".into(), |p| p.to_string());
                Err(self.file.kind(format!("is no raw image (photometric interpretation {other})"), remedy))
            }
        }
    }

    fn check_coding(&mut self) -> Result<(), ImageFileError> {
        match self.number(tags::COMPRESSION)?.unwrap_or(1) {
            1 => Ok(()),
            other => {
                let name = match other {
                    7 => "JPEG (usually lossless)".into(),
                    8 | 32946 => "Deflate".into(),
                    34892 => "lossy JPEG".into(),
                    other => format!("method {other}"),
                };
                Err(self.file.kind(
                    format!("is compressed by {name}, which cannot be read"),
                    "convert it to uncompressed DNG, with Adobe DNG Converter (custom compatibility: uncompressed) or \
                     dnglab convert --compression uncompressed; or to 16-bit TIFF without developing it: dcraw -D -4 \
                     -T",
                ))
            }
        }
    }

    /// Returns top, left, bottom, right of the pixels that see light; the others are masked.
    fn active_area(&mut self, width: usize, height: usize) -> Result<[usize; 4], ImageFileError> {
        let area = self.numbers(tags::ACTIVE_AREA)?;
        if area.is_empty() {
            return Ok([0, 0, height, width]);
        }
        let whole: Vec<usize> = area.iter().map(|&v| v as usize).collect();
        match whole[..] {
            [top, left, bottom, right] if top < bottom && bottom <= height && left < right && right <= width => {
                Ok([top, left, bottom, right])
            }
            _ => Err(self.file.damaged(format_args!("its active area {area:?} does not lie in the image"))),
        }
    }

    /// Returns where the strips or tiles lie, in the file and in the image.
    fn chunks(&mut self, width: usize, height: usize) -> Result<Vec<unpack::Chunk>, ImageFileError> {
        let tiled = !self.numbers(tags::TILE_OFFSETS)?.is_empty();
        let (offsets, lengths) = if tiled {
            (self.numbers(tags::TILE_OFFSETS)?, self.numbers(tags::TILE_BYTE_COUNTS)?)
        } else {
            (self.numbers(tags::STRIP_OFFSETS)?, self.numbers(tags::STRIP_BYTE_COUNTS)?)
        };
        let (w, h) = if tiled {
            (self.need(tags::TILE_WIDTH)?, self.need(tags::TILE_HEIGHT)?)
        } else {
            let rows = self.number(tags::ROWS_PER_STRIP)?.map_or(height, |r| r as usize);
            // Early Chronos firmware writes the width here; one strip is the whole image whatever it says.
            (width, if offsets.len() == 1 { height } else { rows.min(height) })
        };
        if w == 0 || h == 0 {
            return Err(self.file.damaged("its strips or tiles are empty"));
        }
        let (across, down) = (width.div_ceil(w), height.div_ceil(h));
        if offsets.len() != lengths.len() || offsets.len() != across * down {
            let problem = format!("it has {} strips or tiles, not {}", offsets.len(), across * down);
            return Err(self.file.damaged(problem));
        }
        let chunk = |(i, (&offset, &len)): (usize, (&f64, &f64))| unpack::Chunk {
            offset: offset as usize,
            len: len as usize,
            x: i % across * w,
            y: i / across * h,
            width: w,
            rows: h.min(height - i / across * h),
        };
        Ok(offsets.iter().zip(&lengths).enumerate().map(chunk).collect())
    }

    /// Applies the file's own table, which undoes what the camera did to save bits.
    fn linearize(&mut self, codes: &mut [u16]) -> Result<(), ImageFileError> {
        let table: Vec<u16> = self.numbers(tags::LINEARIZATION_TABLE)?.iter().map(|&v| v as u16).collect();
        if let Some(last) = table.len().checked_sub(1) {
            codes.iter_mut().for_each(|c| *c = table[usize::from(*c).min(last)]);
        }
        Ok(())
    }

    /// Returns one black level for all pixels: the mean of those of the filter's cell.
    fn black_level(&mut self) -> Result<Option<f64>, ImageFileError> {
        let levels = self.numbers(tags::BLACK_LEVEL)?;
        let mean = levels.iter().sum::<f64>() / levels.len() as f64;
        Ok((!levels.is_empty() && mean.is_finite()).then_some(mean))
    }

    fn number(&mut self, tag: u16) -> Result<Option<u64>, ImageFileError> {
        self.tags.number(self.dir, tag).map_err(|e| self.file.damaged(e))
    }

    fn numbers(&mut self, tag: u16) -> Result<Vec<f64>, ImageFileError> {
        self.tags.numbers(self.dir, tag).map_err(|e| self.file.damaged(e))
    }

    fn need(&mut self, tag: u16) -> Result<usize, ImageFileError> {
        match self.number(tag)? {
            Some(value) => Ok(value as usize),
            None => Err(self.file.damaged(format_args!("it lacks tag {tag}"))),
        }
    }
}
