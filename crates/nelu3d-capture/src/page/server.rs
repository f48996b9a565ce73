//! What the pages of a capture are answered.

use std::io::Read;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use nelu3d_scan::image::{Image, Raw, RawData, encode_rgb8};
use nelu3d_scan::input::{MAX_DATA, read_file};
use serde::Deserialize;
use tiny_http::Request;

use super::loopback::{LoopbackServer, Reply, Site, body, content, json};
use super::request::{Asked, Refusal};
use super::state::{PageCommand, PageStatus, Shared, WindowReport};
use super::{PageCamera, PageDisplay};
use crate::display::Slide;
use crate::error::CaptureError;
use crate::frame::Frame;

/// Where the images to show lie.
#[derive(Clone, Debug)]
pub struct SlideFiles {
    /// The flash.
    pub white: PathBuf,
    /// Darkness.
    pub black: PathBuf,
    /// The patterns, in the order of [`Slide::Pattern`].
    pub patterns: Vec<PathBuf>,
    /// Size of all of them, px.
    pub size: [usize; 2],
}

/// The pages, while they are served.
pub struct PageServer {
    shared: Arc<Shared>,
    stop: Arc<AtomicBool>,
    clock: Instant,
    server: LoopbackServer,
}

/// Longest wait of a request for the next slide.
const LONGEST_WAIT: Duration = Duration::from_secs(20);
/// Longest wait before looking whether to end.
const TICK: Duration = Duration::from_millis(200);
/// Frames kept for the camera: older ones make room.
const KEPT_FRAMES: usize = 3;

const INDEX_HTML: &str = include_str!("index.html");
const INDEX_JS: &str = include_str!("index.js");
const SCREEN_HTML: &str = include_str!("screen.html");
const SCREEN_JS: &str = include_str!("screen.js");
const STYLE: &str = include_str!("style.css");

/// What is needed to answer.
struct Answers {
    shared: Arc<Shared>,
    slides: SlideFiles,
    clock: Instant,
}

/// What the page says when a slide is on the screen.
#[derive(Deserialize)]
struct ShownBody {
    sequence: u64,
    width: f64,
    height: f64,
    missed: f64,
    warnings: Vec<String>,
}

/// A button of the page.
#[derive(Deserialize)]
struct CommandBody {
    #[serde(rename = "do")]
    what: String,
    #[serde(default)]
    name: String,
}

impl PageServer {
    /// Serves the pages on 127.0.0.1 at `port`, 0 for any that is free. `stop` ends the waiting of its display and
    /// camera.
    ///
    /// # Errors
    ///
    /// The port is taken.
    pub fn start(slides: SlideFiles, port: u16, stop: Arc<AtomicBool>) -> Result<Self, CaptureError> {
        let (shared, clock) = (Arc::new(Shared::default()), Instant::now());
        let server = LoopbackServer::start(Arc::new(Answers { shared: shared.clone(), slides, clock }), port)?;
        Ok(Self { shared, stop, clock, server })
    }

    /// Returns the address of the page for people. That of the patterns is `screen` below it.
    pub fn address(&self) -> &str {
        self.server.address()
    }

    /// Returns the clock of the display and of frames.
    pub fn clock(&self) -> Instant {
        self.clock
    }

    /// Returns the page as a display.
    pub fn display(&self) -> PageDisplay {
        PageDisplay { shared: self.shared.clone(), stop: self.stop.clone() }
    }

    /// Returns the page's webcam as a camera.
    pub fn camera(&self) -> PageCamera {
        PageCamera { shared: self.shared.clone(), stop: self.stop.clone() }
    }

    /// Shows a status on the page.
    pub fn set_status(&self, change: impl FnOnce(&mut PageStatus)) {
        change(&mut self.shared.lock().status);
    }

    /// Shows a picture of the camera on the page: `height × width × 1 or 3`, linear, in [0, 1].
    pub fn set_live(&self, image: &Image) {
        // A page needs no more than this, and encoding takes time.
        let step = image.width.div_ceil(640).max(1);
        let (w, h) = (image.width / step, image.height / step);
        let mut data = Vec::with_capacity(3 * w * h);
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            let pixel = image.pixel(x * step, y * step);
            let code = |c: usize| (255.0 * pixel[c.min(pixel.len() - 1)].clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8;
            data.extend([code(0), code(1), code(2)]);
        }
        let png = encode_rgb8(w, h, &data);
        let mut state = self.shared.lock();
        state.live = png;
        state.status.live += 1;
        state.status.live_size = [image.width, image.height];
    }

    /// Returns the next thing that a person asked for on the page.
    pub fn command(&self) -> Option<PageCommand> {
        self.shared.lock().commands.pop_front()
    }

    /// Returns what is wrong with how the patterns are shown: scaling, a window of another size, missed refreshes.
    pub fn screen_warnings(&self) -> Vec<String> {
        self.shared.lock().window.as_ref().map(|w| w.warnings.clone()).unwrap_or_default()
    }
}

impl std::fmt::Debug for PageServer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PageServer").field("address", &self.address()).finish_non_exhaustive()
    }
}

impl Site for Answers {
    fn reply(&self, path: &str, query: &str, is_post: bool, request: &mut Request) -> Result<Reply, Refusal> {
        self.to(&Asked::at(path, query, is_post)?, request)
    }

    fn end(&self) {
        self.shared.lock().ended = true;
        self.shared.changed.notify_all();
    }
}

impl Answers {
    fn to(&self, asked: &Asked, request: &mut Request) -> Result<Reply, Refusal> {
        Ok(match asked {
            Asked::Index => content("text/html; charset=utf-8", INDEX_HTML.into()),
            Asked::Screen => content("text/html; charset=utf-8", SCREEN_HTML.into()),
            Asked::Script("index") => content("text/javascript", INDEX_JS.into()),
            Asked::Script(_) => content("text/javascript", SCREEN_JS.into()),
            Asked::Style => content("text/css", STYLE.into()),
            Asked::Slide(name) => content("image/png", self.slide(name).ok_or(Refusal::NotFound)?),
            Asked::Next(after) => self.next(*after),
            Asked::Status => {
                let state = self.shared.lock();
                json(&serde_json::json!({
                    "status": state.status,
                    "screen": state.window,
                    "webcam": state.webcam,
                    "frames": state.received,
                }))
            }
            Asked::Live => content("image/png", self.shared.lock().live.clone()),
            Asked::Shown => {
                let at = self.clock.elapsed();
                let body: ShownBody = body(request)?;
                let mut state = self.shared.lock();
                if body.sequence > state.shown {
                    (state.shown, state.shown_at) = (body.sequence, at);
                }
                let ShownBody { width, height, missed, warnings, .. } = body;
                state.window = Some(WindowReport { width, height, missed, warnings });
                self.shared.changed.notify_all();
                json(&serde_json::json!({}))
            }
            Asked::Frame(width, height) => self.frame(*width, *height, request)?,
            Asked::Webcam => {
                let text: String = body(request)?;
                self.shared.lock().webcam = text.chars().take(500).collect();
                json(&serde_json::json!({}))
            }
            Asked::Command => {
                let CommandBody { what, name } = body(request)?;
                let command = match what.as_str() {
                    "take" => PageCommand::Take,
                    "finish" => PageCommand::Finish,
                    "scene" => PageCommand::Scene(name),
                    "stop" => PageCommand::Stop,
                    _ => return Err(Refusal::NotFound),
                };
                self.shared.lock().commands.push_back(command);
                json(&serde_json::json!({}))
            }
        })
    }

    /// Waits for the slide after a sequence number.
    fn next(&self, after: u64) -> Reply {
        let begun = Instant::now();
        let mut state = self.shared.lock();
        while state.sequence <= after && begun.elapsed() < LONGEST_WAIT && !state.ended {
            state = self.shared.wait(state, TICK);
        }
        let slide = match state.slide {
            None => String::new(),
            Some(Slide::White) => "white".into(),
            Some(Slide::Black) => "black".into(),
            Some(Slide::Pattern(i)) => i.to_string(),
        };
        let all = self.slides.patterns.len();
        let ended = state.ended;
        json(&serde_json::json!({
            "sequence": state.sequence, "slide": slide, "size": self.slides.size, "patterns": all, "ended": ended,
        }))
    }

    fn slide(&self, name: &str) -> Option<Vec<u8>> {
        let file = match name {
            "white" => &self.slides.white,
            "black" => &self.slides.black,
            number => self.slides.patterns.get(number.parse::<usize>().ok()?)?,
        };
        read_file(file, MAX_DATA).ok()
    }

    /// Takes a frame: `height × width × 4` bytes of red, green, blue and opacity, as a canvas has them.
    fn frame(&self, width: usize, height: usize, request: &mut Request) -> Result<Reply, Refusal> {
        let at = self.clock.elapsed();
        let n = 4 * width * height;
        let mut bytes = Vec::new();
        let read = request.as_reader().take(n as u64 + 1).read_to_end(&mut bytes);
        if read.is_err() || bytes.len() != n {
            return Err(Refusal::NotFound);
        }
        let data = bytes.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        let raw = Raw { width, height, channels: 3, data: RawData::U8(data) };
        let mut state = self.shared.lock();
        let number = state.received;
        state.received += 1;
        state.frames.push_back(Frame { number, at, raw });
        while state.frames.len() > KEPT_FRAMES {
            state.frames.pop_front();
        }
        self.shared.changed.notify_all();
        Ok(json(&serde_json::json!({})))
    }
}
