//! The sensor's codes, and how they become a linear image.

use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::error::ImageFileError;
use crate::image::response::Response;
use crate::image::{Channels, Image, demosaic};

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
    /// Returns the largest code, or `None` for floats.
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
    /// Returns what a value is stored as.
    pub fn depth(&self) -> Depth {
        match self.data {
            RawData::U8(_) => Depth::U8,
            RawData::U16(_) => Depth::U16,
            RawData::Float(_) => Depth::Float,
        }
    }

    /// Makes the linear image: `(code − black_level) / (saturation − black_level)`, demosaiced for a mosaic. `path` is
    /// only for messages.
    ///
    /// # Errors
    ///
    /// The file has another number of channels than the sensor, a saturation no code of this depth can reach, or a
    /// value that is not a number.
    pub fn linearize(
        &self,
        path: &Path,
        channels: Channels,
        black_level: f64,
        saturation: f64,
    ) -> Result<Image, ImageFileError> {
        self.linearize_by(path, channels, black_level, saturation, &Response::Linear)
    }

    /// Makes the linear image as [`Raw::linearize`] does, of codes that follow light by `response`. Codes become light
    /// before a mosaic is demosaiced.
    ///
    /// # Errors
    ///
    /// As [`Raw::linearize`].
    pub fn linearize_by(
        &self,
        path: &Path,
        channels: Channels,
        black_level: f64,
        saturation: f64,
        response: &Response,
    ) -> Result<Image, ImageFileError> {
        self.check_kind(path, channels, saturation)?;
        let image = self.linear_rows(0..self.height, black_level, saturation, response);
        Ok(match channels {
            Channels::Bayer(cell) => demosaic(&image, cell),
            Channels::Mono | Channels::Rgb => image,
        })
    }

    /// Makes the linear image of some rows as [`Raw::linearize_by`] does, without its checks; a mosaic stays one.
    pub(crate) fn linear_rows(
        &self,
        rows: Range<usize>,
        black_level: f64,
        saturation: f64,
        response: &Response,
    ) -> Image {
        let (b, s) = (black_level, 1.0 / (saturation - black_level));
        let linear = |code: f64| match response {
            Response::Linear => ((code - b) * s) as f32,
            curve => curve.light((code - b) * s) as f32,
        };
        let (height, stride) = (rows.len(), self.width * self.channels);
        let at = rows.start * stride..rows.end * stride;
        let data: Vec<f32> = match &self.data {
            RawData::U8(v) => {
                let table: Vec<f32> = (0..=255u8).map(|c| linear(f64::from(c))).collect();
                v[at].par_iter().map(|&c| table[usize::from(c)]).collect()
            }
            RawData::U16(v) => v[at].par_iter().map(|&c| linear(f64::from(c))).collect(),
            RawData::Float(v) => v[at].par_iter().map(|&c| linear(f64::from(c))).collect(),
        };
        Image { width: self.width, height, channels: self.channels, data }
    }

    /// Complains about what [`Raw::linearize`] cannot use.
    pub(crate) fn check_kind(&self, path: &Path, channels: Channels, saturation: f64) -> Result<(), ImageFileError> {
        let kind = |problem: String, remedy: String| ImageFileError::Kind { path: path.to_path_buf(), problem, remedy };
        if self.channels != channels.in_file() {
            let name = channels.name();
            return Err(if self.channels == 3 {
                let remedy = if self.is_gray() {
                    "its three channels are equal: save it with one (ImageMagick: convert in.png -colorspace \
                     Gray out.png)"
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

    /// Returns whether a three-channel image is really gray.
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
