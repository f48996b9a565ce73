//! One image: which of the frames shows what was asked.

use std::time::Duration;

use crate::camera::{Camera, CameraPace};
use crate::display::{Display, Slide};
use crate::error::CaptureError;
use crate::frame::Frame;
use crate::noise::FrameNoise;
use crate::samples::Samples;
use crate::timing::CaptureTiming;

/// What became of the frames that the camera delivered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct FrameCounts {
    /// Number of frames that the camera delivered.
    pub delivered: usize,
    /// Number of frames that were kept as a part of an image.
    pub accepted: usize,
    /// Number of frames that came too early to show what was asked.
    pub early: usize,
    /// Number of frames that equal the frame before them, bit for bit.
    pub duplicated: usize,
    /// Number of frames that showed what had been shown before.
    pub stale: usize,
    /// Number of frames that agreed with no other: torn, mixed from two slides, or shaken.
    pub lone: usize,
    /// Number of gaps in the frames' times.
    pub lost: usize,
    /// Slides that looked like one before, and were shown again after a flash.
    pub shown_again: usize,
}

impl std::ops::AddAssign for FrameCounts {
    fn add_assign(&mut self, more: Self) {
        self.delivered += more.delivered;
        self.accepted += more.accepted;
        self.early += more.early;
        self.duplicated += more.duplicated;
        self.stale += more.stale;
        self.lone += more.lone;
        self.lost += more.lost;
        self.shown_again += more.shown_again;
    }
}

/// An image of this folder that was accepted.
#[derive(Debug)]
pub(crate) struct Known {
    pub(crate) slide: Slide,
    pub(crate) samples: Samples,
}

/// Frames that must show the same for a picture to count as at rest, and for a slide to count that looks like an
/// earlier one: more than a camera holds back.
const AT_REST: usize = 8;
/// Frames to look at before a slide is given up.
const PATIENCE: usize = 40;
/// Frames to look at before a picture counts as never coming to rest.
const REST_PATIENCE: usize = 900;

/// Takes images.
pub(crate) struct Acquisition<'a> {
    pub(crate) display: &'a mut dyn Display,
    pub(crate) camera: &'a mut dyn Camera,
    pub(crate) timing: CaptureTiming,
    pub(crate) noise: FrameNoise,
    pub(crate) counts: FrameCounts,
    /// What every frame must be: width, height, channels, depth.
    kind: Option<String>,
    last: Option<(Duration, u64)>,
}

/// How looking for a slide ended.
enum Seen {
    Slide(Box<(Frame, Samples)>),
    /// All frames look like this earlier slide.
    Alike(Slide),
}

impl<'a> Acquisition<'a> {
    pub(crate) fn new(
        display: &'a mut dyn Display,
        camera: &'a mut dyn Camera,
        timing: CaptureTiming,
        noise: FrameNoise,
    ) -> Self {
        Self { display, camera, timing, noise, counts: FrameCounts::default(), kind: None, last: None }
    }

    /// Number of frames that must agree. The same frame delivered twice is told by its bits, unless the camera has no
    /// noise: then one more is asked for.
    fn agreeing(&self) -> usize {
        if self.noise.none { 3 } else { 2 }
    }

    fn frames(&self, streaming: usize, on_request: usize) -> usize {
        match self.camera.pace() {
            CameraPace::Streaming => streaming,
            CameraPace::Sparse | CameraPace::OnRequest => on_request,
        }
    }

    /// Waits for a frame; `None` for one that was delivered before, bit for bit.
    fn next(&mut self) -> Result<Option<(Frame, Samples)>, CaptureError> {
        let frame = self.camera.next_frame()?;
        self.counts.delivered += 1;
        let raw = &frame.raw;
        let kind = format!("{} x {} px, {} channels, {}", raw.width, raw.height, raw.channels, raw.depth());
        if let Some(before) = self.kind.replace(kind.clone()).filter(|before| *before != kind) {
            return Err(CaptureError::OtherFrames { before, after: kind });
        }
        let samples = Samples::of(&frame);
        let before = self.last.replace((frame.at, samples.fingerprint));
        if let Some((at, fingerprint)) = before {
            let gap = frame.at.saturating_sub(at).as_secs_f64();
            if self.timing.frame_secs > 0.0 && self.camera.pace() == CameraPace::Streaming {
                self.counts.lost += ((gap / self.timing.frame_secs).round() as usize).saturating_sub(1);
            }
            if fingerprint == samples.fingerprint && !self.noise.none {
                self.counts.duplicated += 1;
                return Ok(None);
            }
        }
        Ok(Some((frame, samples)))
    }

    /// Shows a slide and waits until the picture is at rest on it. Nothing is known of what was shown before: what
    /// `AT_REST` frames show is none of what a camera held back.
    pub(crate) fn at_rest(&mut self, slide: Slide) -> Result<(Frame, Samples), CaptureError> {
        let shown = self.display.show(slide)?;
        let (needed, patience) = (self.frames(AT_REST, 2), self.frames(REST_PATIENCE, 12));
        let earliest = self.timing.earliest(shown, self.camera.pace());
        let mut candidate: Option<(Frame, Samples)> = None;
        let (mut agree, mut others) = (0, 0);
        for _ in 0..patience {
            let Some((frame, samples)) = self.next()? else { continue };
            if frame.at < earliest {
                self.counts.early += 1;
                continue;
            }
            match &candidate {
                Some((_, first)) if self.noise.agree(first, &samples) => {
                    agree += 1;
                    if agree >= needed {
                        self.counts.accepted += 1;
                        return Ok((frame, samples));
                    }
                }
                Some(_) if others < agree / 3 => {
                    others += 1;
                    self.counts.lone += 1;
                }
                _ => {
                    candidate = Some((frame, samples));
                    (agree, others) = (1, 0);
                }
            }
        }
        Err(CaptureError::Unsteady { frames: patience })
    }

    /// Shows a slide and returns the frame that shows it. `known` are all images of this folder so far, the one that
    /// is shown now last; white and black are among them, or the slide is one of these.
    pub(crate) fn acquire(&mut self, slide: Slide, known: &[Known]) -> Result<(Frame, Samples), CaptureError> {
        let shown = self.display.show(slide)?;
        let alike = match self.look(slide, shown, known, None)? {
            Seen::Slide(found) => return Ok(*found),
            Seen::Alike(alike) => alike,
        };
        // Nothing changed that could be seen: the slide looks like an earlier one, or was never shown. A flash that
        // looks like neither comes between.
        self.counts.shown_again += 1;
        let image = |s: Slide| known.iter().find(|k| k.slide == s);
        let other = |s: &Slide| {
            *s != alike
                && image(*s).zip(image(alike)).is_some_and(|(a, b)| !self.noise.resemble(&a.samples, &b.samples))
        };
        let Some(flash) = [Slide::White, Slide::Black].into_iter().find(other) else {
            return Err(CaptureError::Unsteady { frames: self.counts.delivered });
        };
        self.flash(flash, known)?;
        let shown = self.display.show(slide)?;
        match self.look(slide, shown, known, Some((flash, alike)))? {
            Seen::Slide(found) => Ok(*found),
            Seen::Alike(_) => Err(CaptureError::Device {
                device: "the light source".into(),
                problem: "did not show a slide that it said it shows".into(),
                remedy: "see that its window is in front, not minimized, and on the right screen".into(),
            }),
        }
    }

    /// Shows a flash and waits until it is seen for longer than a camera holds frames back.
    fn flash(&mut self, flash: Slide, known: &[Known]) -> Result<(), CaptureError> {
        let image = known.iter().find(|k| k.slide == flash).expect("chosen from these");
        self.display.show(flash)?;
        let (needed, patience) = (self.frames(AT_REST, 1), self.frames(4 * PATIENCE, 8));
        let mut seen = 0;
        for _ in 0..patience {
            if let Some((_, samples)) = self.next()?
                && self.noise.resemble(&samples, &image.samples)
            {
                seen += 1;
                if seen >= needed {
                    return Ok(());
                }
            }
        }
        Err(CaptureError::Unsteady { frames: patience })
    }

    /// Looks for the slide that was announced at `shown`. After a flash, frames may count that look like the slide
    /// `alike`, if they go on to.
    fn look(
        &mut self,
        slide: Slide,
        shown: Duration,
        known: &[Known],
        after: Option<(Slide, Slide)>,
    ) -> Result<Seen, CaptureError> {
        let earliest = self.timing.earliest(shown, self.camera.pace());
        let (patience, persistent) = (self.frames(PATIENCE, 6), self.frames(AT_REST, 2));
        let mut candidates: Vec<(Samples, usize)> = Vec::new();
        let (mut looked, mut alike, mut last_alike) = (0, 0, None);
        while looked < patience {
            let Some((frame, samples)) = self.next()? else { continue };
            if frame.at < earliest {
                self.counts.early += 1;
                continue;
            }
            looked += 1;
            let resembles = |k: &&Known| k.slide != slide && self.noise.resemble(&samples, &k.samples);
            // Of look-alikes the one that was asked about counts.
            let found = known.iter().filter(resembles).map(|k| k.slide);
            let found: Vec<Slide> = found.collect();
            if let Some(first) = found.first() {
                match after {
                    Some((flash, expected)) if found.contains(&expected) && !found.contains(&flash) => {
                        alike += 1;
                        if alike >= persistent && 4 * alike >= 3 * looked {
                            self.counts.accepted += 1;
                            return Ok(Seen::Slide(Box::new((frame, samples))));
                        }
                    }
                    Some(_) => {}
                    None => {
                        alike += 1;
                        last_alike =
                            Some(known.last().map(|k| k.slide).filter(|s| found.contains(s)).unwrap_or(*first));
                    }
                }
                self.counts.stale += 1;
                continue;
            }
            match candidates.iter_mut().find(|(c, _)| self.noise.agree(c, &samples)) {
                Some((_, n)) => {
                    *n += 1;
                    if *n >= self.agreeing() {
                        self.counts.accepted += 1;
                        self.counts.lone += candidates.len() - 1;
                        return Ok(Seen::Slide(Box::new((frame, samples))));
                    }
                }
                None => candidates.push((samples, 1)),
            }
        }
        match last_alike {
            Some(alike_slide) if 2 * alike >= looked => Ok(Seen::Alike(alike_slide)),
            _ if after.is_some() && candidates.is_empty() => Ok(Seen::Alike(slide)),
            _ => Err(CaptureError::Unsteady { frames: looked }),
        }
    }
}
