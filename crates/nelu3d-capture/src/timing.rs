//! Flashes, before anything is captured: how long a change takes to be seen, and how much frames of the same differ.

use std::time::Duration;

use crate::camera::{Camera, CameraPace};
use crate::display::{Display, Slide};
use crate::error::CaptureError;
use crate::frame::Frame;
use crate::noise::{FrameNoise, percentile};
use crate::samples::Samples;

/// When a change of what is shown is seen in the frames.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct CaptureTiming {
    /// Time from one frame to the next, seconds: the median.
    pub frame_secs: f64,
    /// Shortest time from the display's word to the arrival of the first frame that shows the change in full, seconds.
    pub latency_min_secs: f64,
    /// The longest, seconds.
    pub latency_max_secs: f64,
    /// Flashes it was measured with.
    pub flashes: usize,
}

impl CaptureTiming {
    /// Returns the time before which a frame cannot be counted on to show what was announced at `shown`.
    pub(crate) fn earliest(&self, shown: Duration, pace: CameraPace) -> Duration {
        match pace {
            CameraPace::Streaming | CameraPace::Sparse => {
                shown + Duration::from_secs_f64(self.latency_max_secs.max(0.0))
            }
            // It begins an exposure when it is asked to.
            CameraPace::OnRequest => shown,
        }
    }
}

/// What the flashes tell.
#[derive(Debug)]
pub(crate) struct Flashes {
    pub(crate) timing: CaptureTiming,
    pub(crate) noise: FrameNoise,
    pub(crate) white: Frame,
    pub(crate) black: Frame,
}

/// Numbers of frames, which depend on how slowly they come.
struct Numbers {
    /// Frames that must be alike before a picture counts as settled.
    settled: usize,
    /// Frames of settled pictures to measure noise from.
    hold: usize,
    /// Frames to wait for a change.
    patience: usize,
    /// Flashes to time.
    flashes: usize,
}

impl Numbers {
    fn of(pace: CameraPace) -> Self {
        match pace {
            CameraPace::Streaming => Self { settled: 12, hold: 24, patience: 240, flashes: 12 },
            CameraPace::Sparse => Self { settled: 3, hold: 2, patience: 30, flashes: 4 },
            CameraPace::OnRequest => Self { settled: 2, hold: 2, patience: 8, flashes: 2 },
        }
    }
}

/// Largest change of brightness after a flash has arrived, as a part of the step that the flash made. Automatic
/// exposure takes back half and more.
const MAX_DRIFT: f64 = 0.06;
/// Largest change of brightness after a flash has arrived, as a part of the brightness itself.
const MAX_RELATIVE_DRIFT: f64 = 0.1;
/// Smallest difference of white and black, as a part of the scale.
const MIN_STEP: f64 = 0.004;

/// Shows flashes and looks at what becomes of them.
pub(crate) fn measure(display: &mut dyn Display, camera: &mut dyn Camera) -> Result<Flashes, CaptureError> {
    let numbers = Numbers::of(camera.pace());
    // The first is for the camera to begin from a known state.
    let first = hold(display, camera, &numbers, Slide::Black, None)?;
    let white = hold(display, camera, &numbers, Slide::White, Some(first.level))?;
    let black = hold(display, camera, &numbers, Slide::Black, Some(white.level))?;
    let full = white.frames[0].0.raw.depth().max().unwrap_or(1.0);
    let step = white.level - black.level;
    if step < MIN_STEP * full {
        return Err(CaptureError::NoLight { white: white.level, black: black.level, full });
    }
    for (held, slide) in [(&white, "white"), (&black, "black")] {
        for before in [held.early, held.extreme] {
            let drift = (held.level - before).abs();
            // In a picture that is clipped as a whole only darkness tells.
            let relative = drift > MAX_RELATIVE_DRIFT * before && drift > MIN_STEP * 2.0 * full;
            if drift > MAX_DRIFT * step || relative {
                return Err(CaptureError::ExposureNotLocked { slide, before, after: held.level });
            }
        }
    }
    let samples = |held: &Held| held.frames.iter().map(|(_, s)| s.clone()).collect::<Vec<_>>();
    let noise = FrameNoise::measure(&samples(&white), &samples(&black));
    let timing = flashes(display, camera, &numbers, &white, &black)?;
    Ok(Flashes { timing, noise, white: white.typical(), black: black.typical() })
}

/// Frames of a slide that has settled.
struct Held {
    frames: Vec<(Frame, Samples)>,
    /// Median brightness of them.
    level: f64,
    /// Median brightness of the first that showed the slide.
    early: f64,
    /// The brightness that lies furthest beyond both this slide's and the one before: exposures that adapt overshoot.
    extreme: f64,
    /// Means of the picture's rows of blocks.
    rows: Vec<f64>,
}

impl Held {
    /// The frame whose brightness is nearest to the median.
    fn typical(&self) -> Frame {
        let off = |s: &Samples| (s.mean - self.level).abs();
        let nearest = self.frames.iter().min_by(|a, b| off(&a.1).total_cmp(&off(&b.1)));
        nearest.expect("a slide was held for some frames").0.clone()
    }
}

/// Shows a slide until the picture has settled on it, and for some more frames. With the brightness `before` it must
/// have changed to count.
fn hold(
    display: &mut dyn Display,
    camera: &mut dyn Camera,
    numbers: &Numbers,
    slide: Slide,
    before: Option<f64>,
) -> Result<Held, CaptureError> {
    display.show(slide)?;
    let mut all: Vec<(Frame, Samples)> = Vec::new();
    let settled = loop {
        let frame = camera.next_frame()?;
        let samples = Samples::of(&frame);
        all.push((frame, samples));
        let full = all[0].0.raw.depth().max().unwrap_or(1.0);
        if let Some(last) = all.len().checked_sub(numbers.settled).map(|i| &all[i..]) {
            let median = percentile(last.iter().map(|(_, s)| s.mean).collect(), 0.5);
            let tolerance = 0.01 * median + 0.002 * full;
            let near = last.iter().filter(|(_, s)| (s.mean - median).abs() <= tolerance).count();
            let changed = before.is_none_or(|b| (median - b).abs() > MIN_STEP * full);
            // One in five may show something else: stale frames.
            if 5 * near >= 4 * last.len() && changed {
                break all.len();
            }
            if all.len() > numbers.patience {
                return Err(match before {
                    Some(before) if !changed => {
                        let white = if slide == Slide::White { median } else { before };
                        CaptureError::NoLight {
                            white,
                            black: if slide == Slide::White { before } else { median },
                            full,
                        }
                    }
                    _ => CaptureError::Unsteady { frames: all.len() },
                });
            }
        }
    };
    for _ in 0..numbers.hold {
        let frame = camera.next_frame()?;
        let samples = Samples::of(&frame);
        all.push((frame, samples));
    }
    let level = percentile(all[settled..].iter().map(|(_, s)| s.mean).collect(), 0.5);
    let early = early(&all, before, level);
    let extreme = extreme(&all, before, level);
    let frames = all.split_off(settled - numbers.settled);
    // Of stale frames' rows nothing shall be learned.
    let rows: Vec<Vec<f64>> = frames.iter().map(|(_, s)| s.rows()).collect();
    let rows = (0..rows[0].len()).map(|i| percentile(rows.iter().map(|r| r[i]).collect(), 0.5)).collect();
    Ok(Held { frames, level, early, extreme, rows })
}

/// Returns the brightness of the first frames that are more like the level at the end than like that before.
fn early(all: &[(Frame, Samples)], before: Option<f64>, level: f64) -> f64 {
    let Some(before) = before else { return level };
    let is_new = |s: &Samples| (s.mean - before) / (level - before) > 0.5;
    // Two in a row: one may be stale.
    let first = all.windows(2).position(|w| is_new(&w[0].1) && is_new(&w[1].1)).unwrap_or(0);
    // The change itself may still be under way in the first two.
    let some = all[first..].iter().skip(2).take(5).filter(|(_, s)| is_new(s)).map(|(_, s)| s.mean);
    let some: Vec<f64> = some.collect();
    if some.is_empty() { level } else { percentile(some, 0.5) }
}

/// Returns the brightness furthest outside of what lies between the one before and the level at the end, or the level
/// where there is none.
fn extreme(all: &[(Frame, Samples)], before: Option<f64>, level: f64) -> f64 {
    let Some(before) = before else { return level };
    let (low, high) = (before.min(level), before.max(level));
    let beyond = |v: f64| (low - v).max(v - high);
    let furthest = all.iter().map(|(_, s)| s.mean).max_by(|a, b| beyond(*a).total_cmp(&beyond(*b)));
    match furthest {
        Some(v) if v > high => level + (v - high),
        Some(v) if v < low => level - (low - v),
        _ => level,
    }
}

/// Times flashes, from the display's word to the first of two frames that show the change from top to bottom.
fn flashes(
    display: &mut dyn Display,
    camera: &mut dyn Camera,
    numbers: &Numbers,
    white: &Held,
    black: &Held,
) -> Result<CaptureTiming, CaptureError> {
    let steps: Vec<f64> = white.rows.iter().zip(&black.rows).map(|(w, b)| w - b).collect();
    let largest = steps.iter().copied().fold(0.0, f64::max);
    let shows = |samples: &Samples, slide: Slide| {
        let rows = samples.rows();
        let lit = (0..rows.len()).filter(|&i| steps[i] > 0.2 * largest);
        let part = |i: usize| (rows[i] - black.rows[i]) / steps[i];
        lit.map(part).all(|part| if slide == Slide::White { part > 0.85 } else { part < 0.15 })
    };
    let (mut latencies, mut intervals) = (Vec::new(), Vec::new());
    for i in 0..numbers.flashes {
        let slide = if i % 2 == 0 { Slide::White } else { Slide::Black };
        let shown = display.show(slide)?;
        let mut first: Option<Duration> = None;
        let (mut last, mut after, mut n) = (None, 0, 0);
        // Some more frames with the change: stale ones then show nothing older than this flash.
        while after < numbers.settled {
            let frame = camera.next_frame()?;
            let samples = Samples::of(&frame);
            n += 1;
            if n > numbers.patience {
                return Err(CaptureError::Unsteady { frames: n });
            }
            if let Some(last) = last.replace(frame.at) {
                intervals.push(frame.at.saturating_sub(last).as_secs_f64());
            }
            match (shows(&samples, slide), &first) {
                (true, Some(_)) => after += 1,
                (true, None) => first = Some(frame.at),
                // It was a stale one.
                (false, _) if after == 0 => first = None,
                (false, _) => {}
            }
        }
        let at = first.expect("it was seen before it was seen again");
        latencies.push(at.as_secs_f64() - shown.as_secs_f64());
    }
    Ok(CaptureTiming {
        frame_secs: percentile(intervals, 0.5),
        latency_min_secs: latencies.iter().copied().fold(f64::INFINITY, f64::min),
        latency_max_secs: latencies.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        flashes: numbers.flashes,
    })
}
