//! A file being decoded.

use std::path::Path;

use super::error::ImageFileError;
use super::raw::{Raw, RawData};
use crate::input::shortened;

/// Pixels that a byte can stand for at most: Deflate makes 1 of 1032 bytes, and a byte of a bilevel image holds 8
/// pixels.
const MAX_PIXELS_PER_BYTE: usize = 8 * 1032;

/// Largest picture of unknown size, bytes once decoded: 89 megapixels of three 16-bit numbers.
const MAX_DECODED: usize = 512 << 20;

/// A file being decoded: its bytes and how to complain about it.
pub(super) struct File<'a> {
    pub(super) path: &'a Path,
    pub(super) bytes: &'a [u8],
    pub(super) size: Option<(usize, usize)>,
}

impl File<'_> {
    pub(super) fn damaged(&self, reason: impl std::fmt::Display) -> ImageFileError {
        ImageFileError::Damaged { path: self.path.to_path_buf(), reason: shortened(&reason.to_string()) }
    }

    pub(super) fn kind(&self, problem: impl Into<String>, remedy: impl Into<String>) -> ImageFileError {
        ImageFileError::Kind { path: self.path.to_path_buf(), problem: problem.into(), remedy: remedy.into() }
    }

    pub(super) fn alpha(&self) -> ImageFileError {
        self.kind("has an alpha channel", "save it without transparency")
    }

    pub(super) fn check_size(&self, found_width: usize, found_height: usize) -> Result<(), ImageFileError> {
        match self.size {
            Some((width, height)) if (width, height) != (found_width, found_height) => {
                Err(ImageFileError::Size { path: self.path.to_path_buf(), found_width, found_height, width, height })
            }
            _ if found_width == 0 || found_height == 0 => Err(self.damaged("it has no pixels")),
            // A damaged header must not make a decoder ask for all memory there is.
            _ if found_width.saturating_mul(found_height) > self.max_pixels() => {
                Err(self.damaged(format_args!("it claims {found_width}x{found_height} pixels")))
            }
            _ => Ok(()),
        }
    }

    /// Refuses what would unpack to more bytes than any picture has whose size is not known beforehand. Where it is
    /// known, [`File::check_size`] has compared it.
    pub(super) fn check_decoded(&self, bytes: usize) -> Result<(), ImageFileError> {
        if self.size.is_none() && bytes > MAX_DECODED {
            let problem = format!("would unpack to {:.1} GB", bytes as f64 / 1e9);
            return Err(self.kind(problem, format!("save it with fewer pixels: {} MB at most", MAX_DECODED >> 20)));
        }
        Ok(())
    }

    /// Returns how many pixels a file of this length can hold.
    fn max_pixels(&self) -> usize {
        (1 << 16) + self.bytes.len().saturating_mul(MAX_PIXELS_PER_BYTE).min(1 << 28)
    }

    pub(super) fn raw(
        &self,
        width: usize,
        height: usize,
        channels: usize,
        data: RawData,
    ) -> Result<Raw, ImageFileError> {
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
