//! Moving pictures: animated PNG, which browsers and most viewers play, through the `png` crate.

use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use ::png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Filter, Writer};

use crate::output::AtomicFile;

/// An animated PNG file in the making, which runs for ever: 8-bit RGB frames of one size, pushed one after the other.
/// Dropped before [`Apng::finish`], it leaves no file.
pub struct Apng {
    file: Shared,
    writer: Writer<Shared>,
    len: usize,
}

impl Apng {
    /// Starts the file `path` with `frames` frames of `width × height` pixels, `fps` a second.
    ///
    /// # Errors
    ///
    /// The file cannot be created; the message names it.
    ///
    /// # Panics
    ///
    /// If there are no frames or no pixels, or `fps` lies outside 0.001..=65535.
    pub fn create(path: &Path, width: usize, height: usize, frames: usize, fps: f64) -> io::Result<Self> {
        assert!(frames > 0 && width > 0 && height > 0, "frames with pixels");
        assert!((0.001..=65535.0).contains(&fps), "frames a second");
        let size = |n: usize| u32::try_from(n).map_err(|_| io::Error::other("too large for a PNG file"));
        let file = Shared(Arc::new(Mutex::new(Some(AtomicFile::create(path)?))));
        let (w, h, n) = (size(width)?, size(height)?, size(frames)?);
        let mut encoder = Encoder::new(file.clone(), w, h);
        encoder.set_color(ColorType::Rgb);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_compression(Compression::Balanced);
        encoder.set_filter(Filter::Adaptive);
        encoder.set_animated(n, 0).map_err(plain)?;
        let (numerator, denominator) = delay(fps);
        encoder.set_frame_delay(numerator, denominator).map_err(plain)?;
        encoder.validate_sequence(true);
        let writer = encoder.write_header().map_err(plain)?;
        Ok(Self { file, writer, len: width * height * 3 })
    }

    /// Appends a frame of `height × width × 3` bytes.
    ///
    /// # Errors
    ///
    /// The file cannot be written, or has all its frames already.
    ///
    /// # Panics
    ///
    /// If `rgb` has another length.
    pub fn push(&mut self, rgb: &[u8]) -> io::Result<&mut Self> {
        assert_eq!(rgb.len(), self.len, "picture data of another size");
        self.writer.write_image_data(rgb).map_err(plain)?;
        Ok(self)
    }

    /// Puts the file into place.
    ///
    /// # Errors
    ///
    /// Frames are missing, or the file cannot be written; there is no file then.
    pub fn finish(self) -> io::Result<()> {
        self.writer.finish().map_err(plain)?;
        let file = self.file.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        file.expect("only taken here").commit()
    }
}

impl std::fmt::Debug for Apng {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Apng").field("file", &self.file).finish_non_exhaustive()
    }
}

/// The file, which the encoder does not give back.
#[derive(Clone, Debug)]
struct Shared(Arc<Mutex<Option<AtomicFile>>>);

impl Shared {
    fn with<T>(&self, f: impl FnOnce(&mut AtomicFile) -> io::Result<T>) -> io::Result<T> {
        match self.0.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            Some(file) => f(file),
            None => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }
}

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.with(|file| file.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.with(Write::flush)
    }
}

fn plain(e: EncodingError) -> io::Error {
    match e {
        EncodingError::IoError(e) => e,
        other => io::Error::other(other),
    }
}

/// Returns 1 / fps as a fraction of 16-bit numbers: exact for whole numbers, to a thousandth of a frame per second
/// where that fits.
fn delay(fps: f64) -> (u16, u16) {
    let whole = fps.fract() == 0.0;
    let numerator = [1000u16, 100, 10, 1].into_iter().find(|&n| !whole && (f64::from(n) * fps).round() <= 65535.0);
    let numerator = numerator.unwrap_or(1);
    (numerator, (f64::from(numerator) * fps).round() as u16)
}
