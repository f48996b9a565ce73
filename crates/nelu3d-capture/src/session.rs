//! All images of one folder, and what comes before the first.

use std::ops::Range;

use nelu3d_scan::image::Raw;

use crate::acquire::{Acquisition, FrameCounts, Known};
use crate::camera::Camera;
use crate::display::{Display, Slide};
use crate::error::CaptureError;
use crate::exposure::ExposureAdvice;
use crate::frame::Frame;
use crate::noise::FrameNoise;
use crate::timing::{self, CaptureTiming};

/// The images of one folder: a board position or a scene.
#[derive(Debug)]
pub struct SlideImages {
    /// The flash.
    pub white: Frame,
    /// The light source dark.
    pub black: Frame,
    /// One image per image of the pattern set: the patterns, then their inverses.
    pub patterns: Vec<Frame>,
    /// What became of the frames meanwhile.
    pub counts: FrameCounts,
}

/// A display and a camera whose timing and noise are known.
pub struct CaptureSession<'a> {
    acquisition: Acquisition<'a>,
    white: Frame,
    black: Frame,
}

/// Part of the picture's blocks that may differ between the first and the last white image: fingers at the board's
/// edge, a leaf in the wind.
const MAX_MOVED: f64 = 0.02;

impl<'a> CaptureSession<'a> {
    /// Shows flashes, and measures how long they take to be seen and how much frames of the same differ.
    ///
    /// # Errors
    ///
    /// The camera does not see the flashes, or adapts its exposure to them; a device fails.
    pub fn start(display: &'a mut dyn Display, camera: &'a mut dyn Camera) -> Result<Self, CaptureError> {
        let found = timing::measure(display, camera)?;
        let (white, black) = (found.white, found.black);
        Ok(Self { acquisition: Acquisition::new(display, camera, found.timing, found.noise), white, black })
    }

    /// Returns how long changes take to be seen.
    pub fn timing(&self) -> CaptureTiming {
        self.acquisition.timing
    }

    /// Returns how much frames of the same differ.
    pub fn noise(&self) -> FrameNoise {
        self.acquisition.noise
    }

    /// Returns a picture of the flash and one of darkness, from the measurement of the timing or from the folder that
    /// was taken last.
    pub fn flash(&self) -> (&Raw, &Raw) {
        (&self.white.raw, &self.black.raw)
    }

    /// Judges the exposure of the flash; see [`ExposureAdvice::of`].
    pub fn exposure(&self, black_level: f64, saturation: f64) -> ExposureAdvice {
        ExposureAdvice::of(&self.white.raw, &self.black.raw, black_level, saturation)
    }

    /// Shows white, waits until the picture is at rest, and returns it: the live view.
    ///
    /// # Errors
    ///
    /// The picture does not come to rest, or a device fails.
    pub fn look(&mut self) -> Result<Frame, CaptureError> {
        self.acquisition.at_rest(Slide::White).map(|(frame, _)| frame)
    }

    /// Shows white and returns the next frame, whatever it shows.
    ///
    /// # Errors
    ///
    /// A device fails.
    pub fn glance(&mut self) -> Result<Frame, CaptureError> {
        self.acquisition.display.show(Slide::White)?;
        self.acquisition.camera.next_frame()
    }

    /// Takes white, black, and `patterns` patterns, and looks at white once more: nothing may have moved.
    ///
    /// # Errors
    ///
    /// The picture does not come to rest, something moved meanwhile, or a device fails. Nothing is left to clean up:
    /// call it again.
    pub fn take(&mut self, patterns: usize) -> Result<SlideImages, CaptureError> {
        self.take_patterns(0..patterns)
    }

    /// As [`CaptureSession::take`], of some of the display's patterns.
    ///
    /// # Errors
    ///
    /// As [`CaptureSession::take`].
    pub fn take_patterns(&mut self, patterns: Range<usize>) -> Result<SlideImages, CaptureError> {
        self.acquisition.counts = FrameCounts::default();
        let (white, samples) = self.acquisition.at_rest(Slide::White)?;
        let mut known = vec![Known { slide: Slide::White, samples }];
        let mut images = Vec::new();
        for slide in std::iter::once(Slide::Black).chain(patterns.map(Slide::Pattern)) {
            let (frame, samples) = self.acquisition.acquire(slide, &known)?;
            images.push(frame);
            known.push(Known { slide, samples });
        }
        let (_, again) = self.acquisition.acquire(Slide::White, &known)?;
        let moved = self.acquisition.noise.changed(&known[0].samples, &again);
        if moved > MAX_MOVED {
            return Err(CaptureError::Moved { percent: 100.0 * moved });
        }
        let black = images.remove(0);
        (self.white, self.black) = (white.clone(), black.clone());
        Ok(SlideImages { white, black, patterns: images, counts: self.acquisition.counts })
    }
}

impl std::fmt::Debug for CaptureSession<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (timing, noise) = (self.timing(), self.noise());
        f.debug_struct("CaptureSession").field("timing", &timing).field("noise", &noise).finish_non_exhaustive()
    }
}
