//! The context of a reconstruction: progress, clock, observer and device.

use nelu3d_field::device::{Choice, Device, DeviceError};

use super::error::Failure;
use super::lit_part::LitPart;
use super::observer::{Observer, Stage};
use crate::progress::{Progress, StageClock, StageTime};

/// Progress, clock, observer and device of a reconstruction, handed from stage to stage.
pub struct Context<'a> {
    /// Receives what happens, and can stop the work.
    pub progress: &'a Progress,
    /// Times the stages.
    pub clock: StageClock<'a>,
    /// Device of the heavy work.
    pub device: Device,
    /// The part of the picture that the surfaces shown to the observer are of; `None`: all of it.
    pub(super) part: Option<LitPart>,
    observer: Option<&'a mut (dyn Observer + 'a)>,
}

impl<'a> Context<'a> {
    /// Opens the device; no observer receives surfaces yet.
    ///
    /// # Errors
    ///
    /// The device that was asked for is not there.
    pub fn new(progress: &'a Progress, device: Choice) -> Result<Self, DeviceError> {
        Ok(Self {
            progress,
            clock: StageClock::new(progress),
            device: Device::open(device)?,
            part: None,
            observer: None,
        })
    }

    /// Shows every intermediate surface to an observer.
    pub fn with_observer(self, observer: Option<&'a mut (dyn Observer + 'a)>) -> Self {
        Self { observer, ..self }
    }

    /// Returns whether an observer receives surfaces.
    pub fn is_observed(&self) -> bool {
        self.observer.is_some()
    }

    /// Shows the observer, if there is one, the surface after an iteration of a stage, while the clock stands still.
    /// `depth` makes the map of camera z per pixel, mm, NaN where there is none.
    pub fn observe(&mut self, stage: Stage, iteration: usize, depth: impl FnOnce() -> Vec<f32>) {
        if let Some(observer) = self.observer.as_deref_mut() {
            self.clock.pause();
            let depth = depth();
            let depth = match &self.part {
                Some(part) => part.paste(depth, f32::NAN),
                None => depth,
            };
            observer.surface(stage, iteration, &depth);
            self.clock.resume();
        }
    }

    /// Fails if the caller stopped the work.
    pub fn stop_if_cancelled(&self) -> Result<(), Failure> {
        if self.progress.cancelled() { Err(Failure::Cancelled) } else { Ok(()) }
    }

    /// Ends the last stage and returns the times of all.
    pub fn finish(self) -> Vec<StageTime> {
        self.clock.finish()
    }
}
