//! Reading a sweep, position by position.
//!
//! A few positions at most are in memory at a time. Later stages gather what they need of the images while these are
//! read, in sums whose size depends on the volume and the image but not on the number of positions. So some images are
//! read more than once, which costs less than holding them in memory; of a large sensor, whose files take long to decode,
//! blocks of pixels are held, as far as there is room.

use std::path::PathBuf;
use std::sync::OnceLock;

use nelu3d_scan::rig::{Channels, ImageCodes, Need, PatternSet, RigError, Shot, What};
use nelu3d_scan::{Camera, Image, Rig};
use rayon::prelude::*;

use super::binning::binning;
use super::error::CalibrationError;
use super::kept_images::KeptImages;
pub(super) use super::position::Position;
use super::position::PositionBuilder;
use crate::progress::Progress;
use crate::sensor::NoiseModel;

/// Rows of a large sensor's image that are light at a time, about.
const BAND: usize = 256;
/// Largest number of bytes of images in memory while a sweep is read.
const READ_BUDGET: usize = 1 << 30;

/// The positions of a rig's sweep, for one pattern set.
pub struct Sweep<'a> {
    rig: &'a Rig,
    set: &'a PatternSet,
    /// Folders of the positions.
    pub shots: Vec<Shot>,
    /// Number of pattern channels.
    pub k: usize,
    /// Number of channels of the white image: 1 or 3. Pattern channel j is normalized by white channel `j % channels`.
    pub channels: usize,
    /// Side of the blocks of the sensor's pixels that are read as one.
    pub binning: usize,
    min_contrast: f32,
    /// The noise of the pixels that are read, once it is known: positions that are read later are corrected for what it
    /// does to their means.
    pub noise: Option<NoiseModel>,
    pool: rayon::ThreadPool,
    /// Which patterns are mono images of a color camera, as the position that was read first has them, and its folder.
    mono: OnceLock<(Vec<bool>, PathBuf)>,
    /// What a later reading need not decode again.
    kept: KeptImages,
}

impl<'a> Sweep<'a> {
    /// Prepares to read a sweep. `min_contrast` is the smallest usable white − black.
    pub fn new(rig: &'a Rig, set: &'a PatternSet, shots: Vec<Shot>, min_contrast: f32) -> Self {
        let channels = rig.channels.count();
        let k = set.images.len() * channels;
        let binning = binning(rig.camera.n_pixels(), k);
        // Four images, the normalized values and the samples that a stage makes of them.
        let binned = rig.camera.n_pixels() / (binning * binning);
        let full = if binning > 1 { rig.camera.n_pixels() * channels } else { 0 };
        let bytes = 4 * (full + binned * (4 * channels + k + (3 + 2 * k)));
        let at_once = (READ_BUDGET / bytes.max(1)).clamp(1, rayon::current_num_threads());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(at_once).build().expect("a thread pool starts");
        let kept = KeptImages::default();
        Self { rig, set, shots, k, channels, binning, min_contrast, noise: None, pool, mono: OnceLock::new(), kept }
    }

    /// Returns how many images of a position, or bands of them, pass `gather` in [`Self::stream`]: of the patterns and
    /// the white image.
    pub(super) fn n_images(&self) -> usize {
        let is_banded = self.binning > 1 && !matches!(self.rig.channels, Channels::Bayer(_));
        let bands = if is_banded { self.rig.camera.height.div_ceil(BAND) } else { 1 };
        (self.set.images.len() + 1) * bands
    }

    /// Returns the camera of the pixels that are read.
    pub fn camera(&self) -> Camera {
        if self.binning > 1 { self.rig.camera.binned(self.binning) } else { self.rig.camera.clone() }
    }

    /// Returns where a pixel that is read has its middle on the sensor, px.
    pub fn on_sensor(&self, px: [usize; 2]) -> [f64; 2] {
        px.map(|v| (v as f64 + 0.5) * self.binning as f64 - 0.5)
    }

    /// Returns the camera with all of its pixels.
    pub fn sensor(&self) -> &Camera {
        &self.rig.camera
    }

    /// Returns an image as it is read.
    fn binned(&self, image: Image) -> Image {
        if self.binning > 1 { image.binned(self.binning) } else { image }
    }

    /// Returns the sweep's folder.
    pub fn folder(&self) -> std::path::PathBuf {
        self.rig.root.join("calibration")
    }

    /// Retains the positions whose name `is_used` accepts.
    pub fn retain(&mut self, is_used: impl Fn(&str) -> bool) {
        self.shots.retain(|s| is_used(&s.name));
    }

    /// Calls `f` on the white and black image of every position, in parallel, and returns what it returned, in order.
    /// It is checked on the way that the patterns exist, so that a gap in a sweep is reported before work is done.
    ///
    /// # Errors
    ///
    /// An image is missing or cannot be read, or the caller stopped the work.
    pub fn map_white_black<T: Send>(
        &self,
        progress: &Progress,
        f: impl Fn(&Shot, &Image, &Image) -> T + Sync,
    ) -> Result<Vec<T>, CalibrationError> {
        let done = std::sync::atomic::AtomicUsize::new(0);
        let one = |shot: &Shot| {
            if progress.cancelled() {
                return Err(CalibrationError::Cancelled);
            }
            let mut reader = self.rig.reader(shot);
            for name in &self.set.images {
                if !self.rig.has_image(&shot.dir.join(name)) {
                    reader.read(name)?;
                }
            }
            let (white, black) = (reader.read(&self.rig.white)?, reader.read(&self.rig.black)?);
            let answer = f(shot, &white, &black);
            progress.tick(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, self.shots.len());
            Ok(answer)
        };
        self.in_parallel(&self.shots, one)
    }

    /// Calls `f` on positions, as many at a time as memory allows; where that is one, all threads work on it.
    fn in_parallel<P: Sync, T: Send>(
        &self,
        positions: &[P],
        f: impl Fn(&P) -> Result<T, CalibrationError> + Sync,
    ) -> Result<Vec<T>, CalibrationError> {
        if self.pool.current_num_threads() == 1 && rayon::current_num_threads() > 1 {
            return positions.iter().map(f).collect();
        }
        self.pool.install(|| positions.par_iter().map(&f).collect())
    }

    /// Reads the positions `which`, a few at a time. Each position's images, or bands of them, pass `gather`; then `map`
    /// runs on the position, in parallel, with its index and what was gathered. `take` receives what `map` returned, in
    /// order, some positions at a time.
    ///
    /// # Errors
    ///
    /// An image is missing or cannot be read, or the caller stopped the work.
    pub fn stream<S: Default + Send, T: Send>(
        &self,
        which: &[usize],
        progress: &Progress,
        gather: impl Fn(&mut S, &Image) + Sync,
        map: impl Fn(usize, S, &Position) -> T + Sync,
        mut take: impl FnMut(Vec<T>),
    ) -> Result<(), CalibrationError> {
        let mut done = 0;
        // One thread gains nothing from a second position, which is as large as the images; of a large sensor, what is
        // made of one more than there are threads is a tenth of all memory.
        let threads = self.pool.current_num_threads();
        for wave in which.chunks(if threads == 1 || self.binning > 1 { threads } else { 2 * threads }) {
            let one = |p: &usize| {
                if progress.cancelled() {
                    return Err(CalibrationError::Cancelled);
                }
                let mut gathered = S::default();
                let position = self.read(*p, |image| gather(&mut gathered, image))?;
                Ok(map(*p, gathered, &position))
            };
            take(self.in_parallel(wave, one)?);
            done += wave.len();
            progress.tick(done, which.len());
        }
        Ok(())
    }

    /// Reads and normalizes a position; its images of the sensor pass `gather`.
    fn read(&self, p: usize, mut gather: impl FnMut(&Image) + Send) -> Result<Position, CalibrationError> {
        if let Channels::Bayer(cell) = self.rig.channels {
            return self.read_mosaics(p, cell, gather);
        }
        if self.binning > 1 {
            return self.read_blocks(p, gather);
        }
        let mut reader = self.rig.reader(&self.shots[p]);
        let (white, black) = (reader.read(&self.rig.white)?, reader.read(&self.rig.black)?);
        gather(&white);
        let mut builder = PositionBuilder::new(&white, black, self.k, self.min_contrast, self.noise);
        let mut all = Vec::with_capacity(self.set.images.len());
        for name in &self.set.images {
            let (pattern, mono) = reader.read_pattern(name, &white, Some(builder.black()))?;
            all.push(mono);
            // Channels that were made of a mono image do not have the sensor's noise.
            if !mono {
                gather(&pattern);
            }
            builder.add(&pattern);
        }
        self.agree_on_mono(all, &self.shots[p])?;
        Ok(builder.finish())
    }

    /// Reads and normalizes a position of a large sensor in blocks of pixels, band by band: at 31 megapixels, a fifth of
    /// the time went into memory for whole images. Bands of the sensor's pixels pass `gather` when the files are decoded:
    /// the first time.
    fn read_blocks(&self, p: usize, mut gather: impl FnMut(&Image) + Send) -> Result<Position, CalibrationError> {
        let (shot, patterns, camera) = (&self.shots[p], &self.set.images, self.camera());
        if let Some(mut images) = self.kept.give(&shot.name, [camera.width, camera.height, self.channels]) {
            let mut next = || images.next().expect("a position has white and black");
            let (white, black) = (next(), next());
            let mut builder = PositionBuilder::new(&white, black, self.k, self.min_contrast, self.noise);
            images.for_each(|pattern| builder.add(&pattern));
            return Ok(builder.finish());
        }
        let mut reader = self.rig.reader(shot);
        let mut keeping = self.kept.keeping(&shot.name, camera.n_pixels() * (self.k + 2 * self.channels));
        let mut keep = |image: &Image| keeping.iter_mut().for_each(|keeping| keeping.add(image));
        let white = reader.read_codes(&self.rig.white, What::Flash)?;
        // The next image is decoded while one is used.
        let (white, black) =
            rayon::join(|| self.blocks(&white, &mut gather), || reader.read_codes(&self.rig.black, What::Flash));
        let black = black?;
        let (black, mut next) = rayon::join(
            || self.blocks(&black, |_| {}),
            || patterns.first().map(|name| reader.read_codes(name, What::Pattern)),
        );
        [&white, &black].into_iter().for_each(&mut keep);
        let mut builder = PositionBuilder::new(&white, black, self.k, self.min_contrast, self.noise);
        let (mut all, mut flash) = (Vec::with_capacity(patterns.len()), None);
        while let Some(codes) = next.take().transpose()? {
            let (name, following) = (&patterns[all.len()], patterns.get(all.len() + 1));
            let mono = codes.is_mono_among_colors();
            all.push(mono);
            let mut add = |pattern: Image| {
                keep(&pattern);
                builder.add(&pattern);
            };
            if mono {
                // Colored by the flash, pixel by pixel.
                if flash.is_none() {
                    flash = Some((reader.read(&self.rig.white)?, reader.read(&self.rig.black)?));
                }
                let (white, black) = flash.as_ref().expect("it was read");
                add(reader.read_pattern(name, white, Some(black))?.0.binned(self.binning));
            }
            // Channels that were made of a mono image do not have the sensor's noise.
            let blocks = || (!mono).then(|| add(self.blocks(&codes, &mut gather)));
            (_, next) = rayon::join(blocks, || following.map(|name| reader.read_codes(name, What::Pattern)));
        }
        self.agree_on_mono(all, shot)?;
        keeping.into_iter().for_each(|keeping| keeping.finish());
        Ok(builder.finish())
    }

    /// Returns an image of blocks of the sensor's pixels, whose bands pass `gather`.
    fn blocks(&self, codes: &ImageCodes<'_>, mut gather: impl FnMut(&Image)) -> Image {
        let camera = self.camera();
        let mut out = Image { width: camera.width, height: camera.height, channels: self.channels, data: Vec::new() };
        out.data.reserve_exact(camera.n_pixels() * self.channels);
        for band in codes.bands(BAND / self.binning * self.binning) {
            gather(&band);
            out.data.extend_from_slice(&band.binned(self.binning).data);
        }
        out
    }

    /// Reads and normalizes a position of raw mosaics, as a scene is: before they are demosaiced, so that the edges of
    /// the print do not show in the codewords. What passes `gather` is what the sensor measured of each color.
    fn read_mosaics(
        &self,
        p: usize,
        cell: [u8; 4],
        mut gather: impl FnMut(&Image),
    ) -> Result<Position, CalibrationError> {
        let capture = self.rig.read_shot(&self.shots[p], self.set, Need::Calibration)?;
        [&capture.white].into_iter().chain(&capture.patterns).for_each(|image| gather(&measured(image, cell)));
        let black = self.binned(capture.black.expect("a position has a black image"));
        let mut builder =
            PositionBuilder::new(&self.binned(capture.white), black, self.k, self.min_contrast, self.noise);
        capture.patterns.into_iter().for_each(|pattern| builder.add(&self.binned(pattern)));
        self.agree_on_mono(capture.mono, &self.shots[p])?;
        Ok(builder.finish())
    }

    /// Fails if a pattern is mono at one position and colored at another.
    fn agree_on_mono(&self, mono: Vec<bool>, shot: &Shot) -> Result<(), CalibrationError> {
        let (first, dir) = self.mono.get_or_init(|| (mono.clone(), shot.dir.clone()));
        match mono.iter().zip(first).position(|(a, b)| a != b) {
            None => Ok(()),
            Some(i) => {
                let name = &self.set.images[i];
                let (path, other) = (shot.dir.join(name), dir.join(name));
                Err(RigError::MixedChannels { path, mono: mono[i], other }.into())
            }
        }
    }

    /// Returns the patterns that are mono images of a color camera, once the sweep was read.
    pub fn mono(&self) -> Vec<String> {
        let flags = self.mono.get().map_or(&[][..], |(flags, _)| flags);
        self.set.images.iter().zip(flags).filter(|(_, mono)| **mono).map(|(name, _)| name.clone()).collect()
    }
}

/// Returns a demosaiced image without what was interpolated: half as large, of each color one measured value of every
/// cell. Interpolation takes noise away.
pub fn measured(image: &Image, cell: [u8; 4]) -> Image {
    let mut out = Image::new(image.width / 2, image.height / 2, 3);
    let site = [0u8, 1, 2].map(|color| cell.iter().position(|c| *c == color).unwrap_or(0));
    for (i, value) in out.data.iter_mut().enumerate() {
        let (x, y, color) = (i / 3 % out.width, i / 3 / out.width, i % 3);
        let (x, y) = (2 * x + site[color] % 2, 2 * y + site[color] / 2);
        *value = image.data[3 * (y * image.width + x) + color];
    }
    out
}
