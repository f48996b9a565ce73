//! Frames of a USB camera, taken from it on a thread of their own: only so is it known when they arrived.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use viva_u3v::{PAYLOAD_TYPE_CHUNK, PAYLOAD_TYPE_IMAGE, RawFrame, U3vError, U3vStream};

use crate::genicam::frames::WAITING;

/// Time between two looks at whether to stop.
const POLL: Duration = Duration::from_millis(50);
/// Longest time that stopping waits for the thread: a device that sends nonsense without end keeps it busy.
const PATIENCE: Duration = Duration::from_secs(2);

/// A frame of which every byte has arrived.
pub(super) struct Arrived {
    /// When the last of its bytes had come.
    pub(super) at: Instant,
    /// Its format and size, and its pixels, row after row; what follows them is the camera's own.
    pub(super) frame: RawFrame,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Arrived>,
    incomplete: u64,
    /// Why no more will come.
    end: Option<String>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    stop: AtomicBool,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread, and the frames that wait.
pub(super) struct Reader {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Reader {
    /// Begins to read.
    ///
    /// # Errors
    ///
    /// The system gives no thread.
    pub(super) fn start(stream: U3vStream) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let thread = {
            let shared = shared.clone();
            std::thread::Builder::new().name("usb3".into()).spawn(move || read(stream, &shared))?
        };
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Returns the next frame, or none within `longest`. The error says why there are no more.
    pub(super) fn wait_for(&self, longest: Duration) -> Result<Option<Arrived>, String> {
        let idle = |state: &mut State| state.waiting.is_empty() && state.end.is_none();
        let waited = self.shared.changed.wait_timeout_while(self.shared.lock(), longest, idle);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match (state.waiting.pop_front(), &state.end) {
            (Some(frame), _) => Ok(Some(frame)),
            (None, Some(end)) => Err(end.clone()),
            (None, None) if self.thread.as_ref().is_none_or(JoinHandle::is_finished) => {
                Err("is read no more: its driver ended".into())
            }
            (None, None) => Ok(None),
        }
    }

    /// Returns the number of frames that did not arrive whole.
    pub(super) fn incomplete(&self) -> u64 {
        self.shared.lock().incomplete
    }

    /// Ends the reading; what waits is lost.
    pub(super) fn stop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        let Some(thread) = self.thread.take() else { return };
        let begun = Instant::now();
        while !thread.is_finished() && begun.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Reads until told to stop, or until the device is gone.
fn read(mut stream: U3vStream, shared: &Shared) {
    while !shared.stop.load(Ordering::Relaxed) {
        let next = stream.next_frame_within(POLL);
        let at = Instant::now();
        let mut state = shared.lock();
        match next {
            Ok(None) => continue,
            Ok(Some(frame)) if is_whole(&frame) => {
                if state.waiting.len() == WAITING {
                    state.waiting.pop_front();
                }
                state.waiting.push_back(Arrived { at, frame });
            }
            Ok(Some(_)) => state.incomplete += 1,
            Err(e) => {
                let gone = matches!(e, U3vError::Disconnected);
                state.end = Some(if gone { "was unplugged".into() } else { format!("failed ({e})") });
            }
        }
        let ended = state.end.is_some();
        drop(state);
        shared.changed.notify_all();
        if ended {
            return;
        }
    }
}

/// Says whether a frame's end came, without an error, and with as many bytes as that says; only of pictures.
fn is_whole(frame: &RawFrame) -> bool {
    let Some(trailer) = &frame.trailer else { return false };
    // The top bit says that a status is an error: the device dropped a part.
    let complete = trailer.status & 0x8000 == 0 && frame.payload.len() as u64 == trailer.valid_payload_size;
    // A picture may be followed by what was measured with it.
    complete && frame.leader.payload_type & !PAYLOAD_TYPE_CHUNK == PAYLOAD_TYPE_IMAGE
}
