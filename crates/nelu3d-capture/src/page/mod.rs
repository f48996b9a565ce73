//! Pages in a browser: that of a capture, as its display, camera and face ([`PageServer`]), and that of a surface that
//! moves ([`LivePage`]).
//!
//! The program serves them on the loopback interface only, at an address with a secret token in it, and answers
//! requests only that were meant for it (`Host`) and come from it (`Origin`). Nothing that is asked for names a file:
//! slides have numbers. The page of a capture asks for the next slide and the answer waits until there is one; it says
//! when a slide has been on the screen for two refreshes. With a webcam it sends frames as they come, one after the
//! other.

mod live;
mod loopback;
mod request;
mod server;
mod state;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

pub use live::{LiveFiles, LivePage};
pub use server::{PageServer, SlideFiles};
pub use state::{PageCommand, PageStatus};

use self::state::Shared;
use crate::camera::Camera;
use crate::display::{Display, Slide};
use crate::error::CaptureError;
use crate::frame::Frame;

/// Longest time until somebody opens the page, or presses its button for the webcam.
const FIRST_PATIENCE: Duration = Duration::from_secs(120);
/// Longest time that the page may take to show a slide: a window in the background is not drawn at all.
const SHOW_PATIENCE: Duration = Duration::from_secs(15);
/// Longest time between two frames of a webcam.
const FRAME_PATIENCE: Duration = Duration::from_secs(10);
/// Longest wait before looking whether to stop.
const TICK: Duration = Duration::from_millis(100);

/// The page that shows patterns, as a display.
#[derive(Debug)]
pub struct PageDisplay {
    pub(super) shared: Arc<Shared>,
    pub(super) stop: Arc<AtomicBool>,
}

/// The webcam that the page looks through, as a camera.
#[derive(Debug)]
pub struct PageCamera {
    pub(super) shared: Arc<Shared>,
    pub(super) stop: Arc<AtomicBool>,
}

impl Display for PageDisplay {
    fn show(&mut self, slide: Slide) -> Result<Duration, CaptureError> {
        let mut state = self.shared.lock();
        if state.slide != Some(slide) {
            state.slide = Some(slide);
            state.sequence += 1;
        }
        let wanted = state.sequence;
        self.shared.changed.notify_all();
        let begun = Instant::now();
        while state.shown < wanted {
            if self.stop.load(Ordering::Relaxed) {
                return Err(CaptureError::Stopped);
            }
            let patience = if state.shown > 0 { SHOW_PATIENCE } else { FIRST_PATIENCE };
            if begun.elapsed() > patience {
                return Err(CaptureError::Device {
                    device: "the page that shows the patterns".into(),
                    problem: format!("did not answer for {} s", patience.as_secs()),
                    remedy: "open its address on the projector's screen and leave it in front".into(),
                });
            }
            state = self.shared.wait(state, TICK);
        }
        Ok(state.shown_at)
    }
}

impl Camera for PageCamera {
    fn next_frame(&mut self) -> Result<Frame, CaptureError> {
        let mut state = self.shared.lock();
        let begun = Instant::now();
        loop {
            if let Some(frame) = state.frames.pop_front() {
                return Ok(frame);
            }
            if self.stop.load(Ordering::Relaxed) {
                return Err(CaptureError::Stopped);
            }
            let patience = if state.received > 0 { FRAME_PATIENCE } else { FIRST_PATIENCE };
            if begun.elapsed() > patience {
                return Err(CaptureError::Device {
                    device: "the webcam".into(),
                    problem: format!("the page sent no picture for {} s", patience.as_secs()),
                    remedy: "press its button \"Use this webcam\", and leave the page open".into(),
                });
            }
            state = self.shared.wait(state, TICK);
        }
    }
}
