//! What the page and the program know of each other.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::display::Slide;
use crate::exposure::ExposureAdvice;
use crate::frame::Frame;
use crate::guide::Coverage;

/// What a person asked for on the page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PageCommand {
    /// Take this position, or this scene.
    Take,
    /// The sweep is done: go on to the scenes.
    Finish,
    /// Take a scene of this name.
    Scene(String),
    /// End the capture.
    Stop,
}

/// What the page shows about the capture.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct PageStatus {
    /// What is going on: `start`, `sweep`, `scenes`, `busy` or `done`.
    pub stage: &'static str,
    /// What to do next, or what is being done.
    pub message: String,
    /// What went wrong last; empty if nothing.
    pub problem: String,
    /// Corners of the board in the live picture, px.
    pub corners_px: Vec<[f64; 2]>,
    /// What the live picture shows of the board, or why it was not found.
    pub board: String,
    /// Judgment of the exposure.
    pub exposure: Option<ExposureAdvice>,
    /// The judgment in words.
    pub exposure_text: String,
    /// What the sweep covers.
    pub coverage: Coverage,
    /// What a calibration from the positions so far says; empty before there is one.
    pub field: String,
    /// Scenes taken.
    pub scenes: Vec<String>,
    /// Timing in words.
    pub timing: String,
    /// Counts the live pictures, so that the page knows of a new one.
    pub live: u64,
    /// Size of the live picture, px.
    pub live_size: [usize; 2],
}

/// What the page said about the window that shows the patterns.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub(crate) struct WindowReport {
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) missed: f64,
    pub(crate) warnings: Vec<String>,
}

#[derive(Debug, Default)]
pub(crate) struct State {
    pub(crate) slide: Option<Slide>,
    pub(crate) sequence: u64,
    pub(crate) shown: u64,
    pub(crate) shown_at: Duration,
    pub(crate) window: Option<WindowReport>,
    pub(crate) frames: VecDeque<Frame>,
    pub(crate) received: u64,
    pub(crate) webcam: String,
    pub(crate) commands: VecDeque<PageCommand>,
    pub(crate) status: PageStatus,
    /// The live picture as PNG.
    pub(crate) live: Vec<u8>,
    pub(crate) ended: bool,
}

/// [`State`], and a bell that rings when it changes.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    state: Mutex<State>,
    pub(crate) changed: Condvar,
}

impl Shared {
    pub(crate) fn lock(&self) -> MutexGuard<'_, State> {
        // A thread that panicked left numbers and pictures, nothing half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn wait<'a>(&self, state: MutexGuard<'a, State>, longest: Duration) -> MutexGuard<'a, State> {
        self.changed.wait_timeout(state, longest).unwrap_or_else(PoisonError::into_inner).0
    }
}
