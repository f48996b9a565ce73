//! Reading a sweep, position by position.
//!
//! A few positions at most are in memory at a time. Later stages gather what they need of the images while these are
//! read, in sums whose size depends on the volume and the image but not on the number of positions. So some images are
//! read more than once, which costs less than holding them in memory.

use std::path::PathBuf;
use std::sync::OnceLock;

use nelu3d_scan::rig::{PatternSet, RigError, Shot};
use nelu3d_scan::{Image, Rig};
use rayon::prelude::*;

use super::error::CalibrationError;
use crate::progress::Progress;
use crate::sensor::NoiseModel;

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
    min_contrast: f32,
    pool: rayon::ThreadPool,
    /// Which patterns are mono images of a color camera, as the position that was read first has them, and its folder.
    mono: OnceLock<(Vec<bool>, PathBuf)>,
}

impl<'a> Sweep<'a> {
    /// Prepares to read a sweep. `min_contrast` is the smallest usable white − black.
    pub fn new(rig: &'a Rig, set: &'a PatternSet, shots: Vec<Shot>, min_contrast: f32) -> Self {
        let channels = rig.channels.count();
        let k = set.images.len() * channels;
        // Four images, the normalized values and the samples that a stage makes of them.
        let bytes = rig.camera.n_pixels() * 4 * (4 * channels + k + (3 + 2 * k));
        let at_once = (READ_BUDGET / bytes.max(1)).clamp(1, rayon::current_num_threads());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(at_once).build().expect("a thread pool starts");
        Self { rig, set, shots, k, channels, min_contrast, pool, mono: OnceLock::new() }
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
                if !shot.dir.join(name).exists() {
                    reader.read(name)?;
                }
            }
            let (white, black) = (reader.read(&self.rig.white)?, reader.read(&self.rig.black)?);
            let answer = f(shot, &white, &black);
            progress.tick(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, self.shots.len());
            Ok(answer)
        };
        self.pool.install(|| self.shots.par_iter().map(one).collect())
    }

    /// Reads the positions `which`, a few at a time. Each position's images pass `gather` as they are read; then `map`
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
        for wave in which.chunks(2 * self.pool.current_num_threads()) {
            let one = |p: &usize| {
                if progress.cancelled() {
                    return Err(CalibrationError::Cancelled);
                }
                let mut gathered = S::default();
                let position = self.read(*p, |image| gather(&mut gathered, image))?;
                Ok(map(*p, gathered, &position))
            };
            take(self.pool.install(|| wave.par_iter().map(one).collect::<Result<Vec<_>, CalibrationError>>())?);
            done += wave.len();
            progress.tick(done, which.len());
        }
        Ok(())
    }

    /// Reads and normalizes a position; its images of the sensor pass `gather`.
    fn read(&self, p: usize, mut gather: impl FnMut(&Image)) -> Result<Position, CalibrationError> {
        let mut reader = self.rig.reader(&self.shots[p]);
        let (white, black) = (reader.read(&self.rig.white)?, reader.read(&self.rig.black)?);
        gather(&white);
        let mut builder = PositionBuilder::new(&white, black, self.k, self.min_contrast);
        let mut all = Vec::with_capacity(self.set.images.len());
        for name in &self.set.images {
            let (pattern, mono) = reader.read_pattern(name, &white, Some(&builder.black))?;
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

/// The normalized intensities of one board position.
pub struct Position {
    /// Width, samples.
    pub width: usize,
    /// Height, samples.
    pub height: usize,
    /// Number of pattern channels.
    pub k: usize,
    /// Number of channels of the white image.
    pub channels: usize,
    /// Normalized intensity, `height × width × k`.
    pub values: Vec<f32>,
    /// White − black, `height × width × channels`; 0 where the sample cannot be used.
    pub contrast: Vec<f32>,
}

impl Position {
    /// Returns the values of a sample, and writes their weights (one over the variance; 0 = unusable) to `w`; `None`
    /// when no value is usable.
    #[inline]
    pub fn sample(&self, i: usize, noise: &NoiseModel, w: &mut [f32]) -> Option<&[f32]> {
        let v = &self.values[i * self.k..(i + 1) * self.k];
        let contrast = &self.contrast[i * self.channels..(i + 1) * self.channels];
        if contrast.iter().all(|c| *c <= 0.0) {
            return None;
        }
        for (j, (w, v)) in w.iter_mut().zip(v).enumerate() {
            let contrast = contrast[j % self.channels];
            *w = if contrast > 0.0 { 1.0 / noise.normalized_variance(*v, contrast, 0.0) } else { 0.0 };
        }
        Some(v)
    }

    /// Returns the position averaged over blocks of `block × block` pixels, as a camera of larger pixels would have
    /// measured it. A block is usable where all its pixels are.
    pub fn reduced(&self, block: usize) -> Self {
        let (w, h, c, k) = (self.width / block, self.height / block, self.channels, self.k);
        let mut values = Vec::with_capacity(w * h * k);
        let mut contrast = Vec::with_capacity(w * h * c);
        let pixels = |x: usize, y: usize| {
            (0..block * block).map(move |i| (y * block + i / block) * self.width + x * block + i % block)
        };
        let norm = 1.0 / (block * block) as f32;
        for y in 0..h {
            for x in 0..w {
                for j in 0..k {
                    // The mean weighted by contrast is the ratio of mean intensities, as a larger pixel measures it.
                    let (mut num, mut den) = (0.0, 0.0);
                    for i in pixels(x, y) {
                        let d = self.contrast[i * c + j % c];
                        num += d * self.values[i * k + j];
                        den += d;
                    }
                    values.push(if den > 0.0 { num / den } else { 0.0 });
                }
                for ch in 0..c {
                    let usable = pixels(x, y).all(|i| self.contrast[i * c + ch] > 0.0);
                    let d: f32 = pixels(x, y).map(|i| self.contrast[i * c + ch]).sum();
                    contrast.push(if usable { d * norm } else { 0.0 });
                }
            }
        }
        Self { width: w, height: h, k, channels: c, values, contrast }
    }
}

/// Builds a [`Position`] image by image, so that only white, black and one pattern are in memory at a time.
pub(super) struct PositionBuilder {
    black: Image,
    /// Number of pattern channels so far.
    filled: usize,
    position: Position,
}

impl PositionBuilder {
    /// Starts a position from its white and black images; `threshold` is the smallest usable
    /// white − black.
    pub(super) fn new(white: &Image, black: Image, k: usize, threshold: f32) -> Self {
        let (width, height, channels) = (white.width, white.height, white.channels);
        let mut contrast = white.data.clone();
        for (w, b) in contrast.iter_mut().zip(&black.data) {
            let d = *w - b;
            *w = if *w < 1.0 && d >= threshold { d } else { 0.0 };
        }
        let values = vec![0.0; width * height * k];
        Self { black, filled: 0, position: Position { width, height, k, channels, values, contrast } }
    }

    /// Adds the next pattern image. A clipped pixel is unusable in that channel.
    pub(super) fn add(&mut self, pattern: &Image) {
        let p = &mut self.position;
        let (c, k) = (p.channels, p.k);
        assert_eq!(pattern.data.len(), self.black.data.len());
        let pixels = pattern.data.chunks_exact(c).zip(self.black.data.chunks_exact(c));
        let targets = p.values.chunks_exact_mut(k).zip(p.contrast.chunks_exact_mut(c));
        for ((pattern, black), (values, contrast)) in pixels.zip(targets) {
            for ch in 0..c {
                if pattern[ch] >= 1.0 {
                    contrast[ch] = 0.0;
                }
                if contrast[ch] > 0.0 {
                    values[self.filled + ch] = (pattern[ch] - black[ch]) / contrast[ch];
                }
            }
        }
        self.filled += c;
    }

    /// Returns the finished position.
    pub(super) fn finish(self) -> Position {
        assert_eq!(self.filled, self.position.k);
        self.position
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(v: [f32; 4]) -> Image {
        Image { width: 2, height: 2, channels: 1, data: v.to_vec() }
    }

    #[test]
    fn normalizes_and_marks_unusable_pixels() {
        let mut b = PositionBuilder::new(&image([0.5, 0.5, 0.015, 1.0]), image([0.1, 0.0, 0.0, 0.0]), 2, 0.02);
        b.add(&image([0.3, 0.25, 0.01, 0.2]));
        b.add(&image([0.1, 1.0, 0.01, 0.2]));
        let p = b.finish();
        assert!((p.values[0] - 0.5).abs() < 1e-6);
        assert_eq!(p.values[1], 0.0);
        let usable: Vec<bool> = p.contrast.iter().map(|c| *c > 0.0).collect();
        assert_eq!(usable, [true, false, false, false]);
        let mut w = [9.0; 2];
        let noise = NoiseModel { read: 1e-4, gain: 0.0 };
        assert_eq!(p.sample(0, &noise, &mut w).unwrap().len(), 2);
        // Contrast 0.4, L = 0.5: variance (1 + ¼ + ¼) 1e-4 / 0.16.
        assert!((w[0] - 0.16 / 1.5e-4).abs() < 1.0, "{w:?}");
        assert!(p.sample(1, &noise, &mut w).is_none());
    }

    struct Silent;

    impl crate::progress::Sink for Silent {
        fn stage(&self, _: &str) {}
        fn tick(&self, _: usize, _: usize) {}
        fn warn(&self, _: &str) {}
    }

    /// A rig of `n` positions of 4 × 3 pixels whose pattern image holds the position's number.
    fn rig(dir: &std::path::Path, n: usize) -> (Rig, PatternSet) {
        let set = PatternSet { name: "p".into(), images: vec!["p.png".into()], inverse: Vec::new() };
        for i in 0..n {
            let shot = dir.join("calibration").join(format!("{i:03}"));
            std::fs::create_dir_all(&shot).unwrap();
            for (name, value) in [("white.png", 0.5), ("black.png", 0.0), ("p.png", 0.005 * i as f32)] {
                let image = Image { width: 4, height: 3, channels: 1, data: vec![value; 12] };
                nelu3d_scan::image::write_png16(&shot.join(name), &image, 0.0, 2000.0).unwrap();
            }
        }
        let rig = Rig {
            root: dir.to_path_buf(),
            name: String::new(),
            camera: nelu3d_scan::Camera::pinhole(4, 3, 5.0, 5.0, 2.0, 1.5),
            camera_file: "camera.json".into(),
            channels: nelu3d_scan::image::Channels::Mono,
            black_level: 0.0,
            saturation: 2000.0,
            white: "white.png".into(),
            black: "black.png".into(),
            pattern_sets: vec![set.clone()],
            board: None,
            poses: Vec::new(),
            projector: None,
        };
        (rig, set)
    }

    #[test]
    fn positions_stream_in_order_a_few_at_a_time() {
        let dir = tempfile::tempdir().unwrap();
        let (rig, set) = rig(dir.path(), 23);
        let sweep = Sweep::new(&rig, &set, rig.positions().unwrap(), 0.02);
        let which: Vec<usize> = (0..23).filter(|i| i % 5 != 2).collect();
        let (mut received, mut largest) = (Vec::new(), 0);
        let map = |p: usize, images: usize, position: &Position| (p, images, position.values[7]);
        let take = |wave: Vec<_>| {
            largest = largest.max(wave.len());
            received.extend(wave);
        };
        sweep.stream(&which, &Progress::none(), |n: &mut usize, _| *n += 1, map, take).unwrap();
        assert!(largest <= 2 * rayon::current_num_threads(), "{largest}");
        assert_eq!(received.iter().map(|s| s.0).collect::<Vec<_>>(), which);
        // White and pattern were gathered; the values are the position's own.
        assert!(received.iter().all(|(p, images, v)| *images == 2 && (v - 0.01 * *p as f32).abs() < 1e-6));
    }

    #[test]
    fn gaps_are_named_before_work_is_done_and_stopping_stops() {
        let dir = tempfile::tempdir().unwrap();
        let (rig, set) = rig(dir.path(), 4);
        let sweep = Sweep::new(&rig, &set, rig.positions().unwrap(), 0.02);
        let names = sweep.map_white_black(&Progress::none(), |shot, _, _| shot.name.clone()).unwrap();
        assert_eq!(names, ["000", "001", "002", "003"]);
        let gap = dir.path().join("calibration/002/p.png");
        std::fs::remove_file(&gap).unwrap();
        let error = sweep.map_white_black(&Progress::none(), |_, _, _| ()).unwrap_err().to_string();
        assert!(error.contains(gap.to_str().unwrap()), "{error}");
        let error =
            sweep.stream(&[1, 2], &Progress::none(), |(), _| (), |_, (), _| (), |_| ()).unwrap_err().to_string();
        assert!(error.contains(gap.to_str().unwrap()), "{error}");
        let stop = Progress::new(std::sync::Arc::new(Silent), std::sync::Arc::new(true.into()));
        assert!(matches!(sweep.map_white_black(&stop, |_, _, _| ()), Err(CalibrationError::Cancelled)));
        let stopped = sweep.stream(&[0], &stop, |(), _| (), |_, (), _| (), |_| ());
        assert!(matches!(stopped, Err(CalibrationError::Cancelled)));
    }

    #[test]
    fn a_block_is_what_a_larger_pixel_measures() {
        let mut b = PositionBuilder::new(&image([0.5, 0.3, 0.1, 0.9]), image([0.0; 4]), 1, 0.02);
        b.add(&image([0.5, 0.0, 0.1, 0.0]));
        let p = b.finish().reduced(2);
        assert_eq!((p.width, p.height), (1, 1));
        assert!((p.values[0] - 0.6 / 1.8).abs() < 1e-6 && (p.contrast[0] - 0.45).abs() < 1e-6);
        let mut b = PositionBuilder::new(&image([0.5, 0.3, 0.1, 0.9]), image([0.0; 4]), 1, 0.02);
        b.add(&image([0.5, 1.0, 0.1, 0.0]));
        assert_eq!(b.finish().reduced(2).contrast, [0.0]);
    }
}
