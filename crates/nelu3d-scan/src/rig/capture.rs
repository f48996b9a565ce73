//! Reading the images of a shot.

use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::{PatternSet, Rig, RigError, Shot, mono, mosaic};
use crate::image::{Channels, Depth, Image, ImageFileError, Raw, Response, decode, demosaic, follow};
use crate::input::open_file;

/// Which of a shot's images must be there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// A board position: white, black and every pattern.
    Calibration,
    /// A scene that stands still: white and every pattern; black where there is one.
    Scene,
    /// A frame of a sequence, whose pattern and white need not show the same: as a scene, but mosaics are demosaiced
    /// one by one.
    Frame,
}

/// The role of an image in a shot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// White or black: as the camera takes images.
    Flash,
    /// A pattern or its inverse, which may be a mono image of a color camera.
    Pattern,
}

/// The images of one shot, linear (see [`Image`]). All have the camera's size and the same number of channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// The flash: every projector pixel at its maximum.
    pub white: Image,
    /// The ambient light.
    pub black: Option<Image>,
    /// One image per pattern of the set, in its order.
    pub patterns: Vec<Image>,
    /// For each pattern, whether it is a mono image of a color camera: one value a pixel, whose ratio to the flash
    /// stands in all three channels.
    pub mono: Vec<bool>,
}

/// Reads the images of one shot one at a time, for callers that do not want all of them in memory.
pub struct ShotReader<'a> {
    rig: &'a Rig,
    shot: &'a Shot,
    depth: Option<(Depth, PathBuf)>,
}

/// One image of a shot as it was stored, for callers that do not want all of a large one as light at once.
pub struct ImageCodes<'a> {
    rig: &'a Rig,
    raw: Raw,
}

impl ImageCodes<'_> {
    /// Returns whether it is a mono image of a color camera (see [`Capture::mono`]).
    pub fn is_mono_among_colors(&self) -> bool {
        self.raw.channels < self.rig.channels.count()
    }

    /// Returns the linear images of bands of `rows` rows, from the top; the last one may have fewer. Of a mosaic, mosaics.
    pub fn bands(&self, rows: usize) -> impl Iterator<Item = Image> {
        let height = self.raw.height;
        let band = move |y: usize| self.rig.linear_rows(&self.raw, y..(y + rows).min(height));
        (0..height).step_by(rows).map(band)
    }
}

impl<'a> ShotReader<'a> {
    /// Reads the image of this file name as it is stored.
    ///
    /// # Errors
    ///
    /// As [`ShotReader::read`].
    pub fn read_codes(&mut self, name: &str, what: What) -> Result<ImageCodes<'a>, RigError> {
        let path = self.shot.dir.join(name);
        let (raw, _) = self.rig.decode_as(&path, what)?;
        agree(&path, raw.depth(), &mut self.depth)?;
        Ok(ImageCodes { rig: self.rig, raw })
    }

    /// Reads the image of this file name.
    ///
    /// # Errors
    ///
    /// As [`Rig::read_image`], or it has another bit depth than the image read first.
    pub fn read(&mut self, name: &str) -> Result<Image, RigError> {
        self.rig.read_agreeing(&self.shot.dir.join(name), self.rig.channels, What::Flash, &mut self.depth)
    }

    /// Reads a pattern of this file name, and says whether it is a mono image of a color camera (see
    /// [`Capture::mono`]): such a one needs the shot's flash.
    ///
    /// # Errors
    ///
    /// As [`ShotReader::read`].
    pub fn read_pattern(
        &mut self,
        name: &str,
        white: &Image,
        black: Option<&Image>,
    ) -> Result<(Image, bool), RigError> {
        let path = self.shot.dir.join(name);
        let image = self.rig.read_agreeing(&path, self.rig.channels, What::Pattern, &mut self.depth)?;
        Ok(colored(image, white, black))
    }
}

impl Rig {
    /// Reads one image of this rig's camera.
    ///
    /// # Errors
    ///
    /// The file is missing, cannot be decoded, has another size than the intrinsics, another number of channels than
    /// the camera, or a bit depth that cannot reach the saturation.
    pub fn read_image(&self, path: &Path) -> Result<Image, RigError> {
        self.read_with_depth(path).map(|(image, _)| image)
    }

    pub(super) fn read_with_depth(&self, path: &Path) -> Result<(Image, Depth), RigError> {
        self.read_as(path, self.channels, What::Flash)
    }

    /// Returns the channels that a file has to have: the camera's, or one for a mono image among a color camera's.
    pub(super) fn stored_as(&self, raw: &Raw, what: What) -> Channels {
        let is_mono = what == What::Pattern && self.channels == Channels::Rgb && raw.channels == 1;
        if is_mono { Channels::Mono } else { self.channels }
    }

    /// Decodes an image, and returns the channels that its file has to have; complains if it does not fit the camera.
    fn decode_as(&self, path: &Path, what: What) -> Result<(Raw, Channels), RigError> {
        let size = (self.camera.width, self.camera.height);
        let raw = match &self.memory {
            Some(memory) => memory.read(path, size)?,
            None => decode(path, Some(size))?,
        };
        let stored = self.stored_as(&raw, what);
        raw.check_kind(path, stored, self.saturation)?;
        self.check_response(path)?;
        Ok((raw, stored))
    }

    /// Reads an image; a mosaic stays one if `channels` says that there is one channel.
    fn read_as(&self, path: &Path, channels: Channels, what: What) -> Result<(Image, Depth), RigError> {
        let (raw, stored) = self.decode_as(path, what)?;
        let channels = if stored == self.channels { channels } else { stored };
        let image = self.linear(&raw, path, channels)?;
        Ok((image, raw.depth()))
    }

    /// Makes the linear image of some rows of codes of this rig's camera; a mosaic stays one.
    fn linear_rows(&self, raw: &Raw, rows: Range<usize>) -> Image {
        raw.linear_rows(rows, self.black_level, self.saturation, self.response())
    }

    /// Returns how this rig's codes follow light.
    fn response(&self) -> &Response {
        self.response.as_ref().unwrap_or(&Response::Linear)
    }

    /// Makes the linear image of codes of this rig's camera, of `channels`. `path` is only for messages.
    ///
    /// # Errors
    ///
    /// As [`Raw::linearize`].
    pub fn linear(&self, raw: &Raw, path: &Path, channels: Channels) -> Result<Image, ImageFileError> {
        raw.linearize_by(path, channels, self.black_level, self.saturation, self.response())
    }

    /// Complains about a JPEG file unless rig.toml says how its codes follow light: they are hardly ever linear.
    pub(super) fn check_response(&self, path: &Path) -> Result<(), ImageFileError> {
        if self.response.is_some() || self.memory.is_some() || !is_jpeg(path) {
            return Ok(());
        }
        Err(ImageFileError::Kind {
            path: path.to_path_buf(),
            problem: "is a JPEG file, whose codes hardly ever follow light evenly, and rig.toml does not say how"
                .into(),
            remedy: "set response = \"srgb\" in its table [camera], or the name of a measured curve".into(),
        })
    }

    /// Reads a shot's white, black and the patterns of one set. Raw mosaics of what stands still are normalized before
    /// they are demosaiced: the patterns are then those whose ratio to white is that of the mosaics.
    ///
    /// # Errors
    ///
    /// As [`Rig::read_image`], for the first image that fails; or images of different bit depths.
    pub fn read_shot(&self, shot: &Shot, set: &PatternSet, need: Need) -> Result<Capture, RigError> {
        let mut depth = None;
        let (cell, channels) = match self.channels {
            Channels::Bayer(cell) if need != Need::Frame => (Some(cell), Channels::Mono),
            other => (None, other),
        };
        let mut read = |name: &str, what| self.read_agreeing(&shot.dir.join(name), channels, what, &mut depth);
        let mut white = read(&self.white, What::Flash)?;
        let wanted = need == Need::Calibration || self.has_image(&shot.dir.join(&self.black));
        let mut black = wanted.then(|| read(&self.black, What::Flash)).transpose()?;
        let mut patterns = set.images.iter().map(|name| read(name, What::Pattern)).collect::<Result<Vec<_>, _>>()?;
        let mut mono = vec![false; patterns.len()];
        if let Some(cell) = cell {
            let (white_rgb, black_rgb) = (demosaic(&white, cell), black.as_ref().map(|b| demosaic(b, cell)));
            for pattern in &mut patterns {
                *pattern =
                    mosaic::pattern_of_mosaic(pattern, &white, black.as_ref(), &white_rgb, black_rgb.as_ref(), cell);
            }
            (white, black) = (white_rgb, black_rgb);
        }
        for (pattern, mono) in patterns.iter_mut().zip(&mut mono) {
            (*pattern, *mono) = colored(std::mem::replace(pattern, Image::new(0, 0, 1)), &white, black.as_ref());
        }
        Ok(Capture { white, black, patterns, mono })
    }

    /// Reads a shot's images one at a time.
    pub fn reader<'a>(&'a self, shot: &'a Shot) -> ShotReader<'a> {
        ShotReader { rig: self, shot, depth: None }
    }

    /// Reads a shot's inverse images of one set, in its order; none if the set has none.
    ///
    /// # Errors
    ///
    /// As [`Rig::read_shot`].
    pub fn read_inverse(&self, shot: &Shot, set: &PatternSet) -> Result<Vec<Image>, RigError> {
        let mut depth = None;
        let mut read =
            |name: &String| self.read_agreeing(&shot.dir.join(name), self.channels, What::Pattern, &mut depth);
        let mut inverse = set.inverse.iter().map(&mut read).collect::<Result<Vec<_>, _>>()?;
        if inverse.iter().any(|image| image.channels < self.channels.count()) {
            let mut reader = self.reader(shot);
            let white = reader.read(&self.white)?;
            let black = self.has_image(&shot.dir.join(&self.black)).then(|| reader.read(&self.black)).transpose()?;
            inverse = inverse.into_iter().map(|image| colored(image, &white, black.as_ref()).0).collect();
        }
        Ok(inverse)
    }

    /// Reads an image and compares its depth with the first one's.
    fn read_agreeing(
        &self,
        path: &Path,
        channels: Channels,
        what: What,
        first: &mut Option<(Depth, PathBuf)>,
    ) -> Result<Image, RigError> {
        let (image, depth) = self.read_as(path, channels, what)?;
        agree(path, depth, first)?;
        Ok(image)
    }
}

/// Compares the depth of an image with that of the first one, and complains about another one.
fn agree(path: &Path, depth: Depth, first: &mut Option<(Depth, PathBuf)>) -> Result<(), RigError> {
    let (other_depth, other) = first.get_or_insert_with(|| (depth, path.to_path_buf()));
    if *other_depth == depth {
        return Ok(());
    }
    Err(RigError::MixedDepth { path: path.to_path_buf(), depth, other: other.clone(), other_depth: *other_depth })
}

/// Returns whether a file begins as JPEG files do.
fn is_jpeg(path: &Path) -> bool {
    let mut begin = [0; 3];
    let Ok(path) = follow(path) else { return false };
    let read = open_file(&path).and_then(|(mut file, _)| file.read_exact(&mut begin));
    read.is_ok() && begin == [0xff, 0xd8, 0xff]
}

/// Returns a pattern with as many channels as its flash, and whether it had fewer.
fn colored(image: Image, white: &Image, black: Option<&Image>) -> (Image, bool) {
    if image.channels == white.channels { (image, false) } else { (mono::spread_mono(&image, white, black), true) }
}
