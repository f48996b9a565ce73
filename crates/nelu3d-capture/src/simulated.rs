//! A display and a camera that do wrong what real ones do: they are late, unevenly so, and deliver frames torn, mixed,
//! twice, from long ago, or not at all. They run on a clock of their own, so nothing waits. For tests, and for trying a
//! capture without hardware.

use std::cell::RefCell;
use std::collections::{HashMap, VecDeque};
use std::rc::Rc;
use std::time::Duration;

use nelu3d_scan::image::{Raw, RawData};

use crate::camera::Camera;
use crate::display::{Display, Slide};
use crate::error::CaptureError;
use crate::frame::Frame;

/// What goes wrong, and how often.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatedFaults {
    /// Time from the display's word to the change, frames.
    pub latency_frames: f64,
    /// The latency varies evenly by this much up and down, frames.
    pub jitter_frames: f64,
    /// Part of the frames that are lost.
    pub loss: f64,
    /// Part of the frames that show what an earlier one showed; half of those are that frame, bit for bit.
    pub stale: f64,
    /// How far back that is at most, frames.
    pub stale_depth: usize,
    /// Part of the frames that are delivered a second time.
    pub duplicated: f64,
    /// Standard deviation of a dark pixel, codes.
    pub read_noise: f64,
    /// Variance of a code that comes with light, codes per code.
    pub shot_noise: f64,
    /// Part of its brightness that automatic exposure takes back in each frame: 0 for a locked exposure.
    pub automatic_exposure: f64,
}

impl Default for SimulatedFaults {
    /// A good camera and a good display, two frames late.
    fn default() -> Self {
        Self {
            latency_frames: 2.0,
            jitter_frames: 0.3,
            loss: 0.0,
            stale: 0.0,
            stale_depth: 4,
            duplicated: 0.0,
            read_noise: 1.5,
            shot_noise: 0.02,
            automatic_exposure: 0.0,
        }
    }
}

/// Time from one frame to the next, seconds.
const FRAME_SECS: f64 = 1.0 / 30.0;
/// Part of that time in which the shutter is open.
const EXPOSURE: f64 = 0.5;

/// What the display and the camera share.
struct Room {
    images: HashMap<Slide, Raw>,
    faults: SimulatedFaults,
    random: Random,
    normal: Vec<f32>,
    /// Seconds since the beginning.
    clock: f64,
    /// When which slide came to be seen.
    changes: Vec<(f64, Slide)>,
    /// Frames that the camera has exposed.
    exposed: u64,
    /// What each delivered frame shows; `None` for a mixture.
    labels: Vec<Option<Slide>>,
    /// The latest frames, as exposed.
    latest: VecDeque<(Option<Slide>, Raw)>,
    /// A frame that will be delivered again.
    again: Option<(Option<Slide>, Raw)>,
    gain: f64,
    /// What each frame is moved by, px.
    shake: usize,
}

/// A display and a camera in one simulated room.
#[derive(Clone)]
pub struct SimulatedRoom(Rc<RefCell<Room>>);

impl SimulatedRoom {
    /// Returns a room in which each slide looks as its image says: 8- or 16-bit codes, without noise, of one size. The
    /// same seed gives the same course of events.
    ///
    /// # Panics
    ///
    /// If there is no image of white.
    pub fn new(images: HashMap<Slide, Raw>, faults: SimulatedFaults, seed: u64) -> Self {
        assert!(images.contains_key(&Slide::White), "no image of white");
        let mut random = Random(seed);
        let normal = (0..1 << 15).map(|_| random.normal() as f32).collect();
        Self(Rc::new(RefCell::new(Room {
            images,
            faults,
            random,
            normal,
            clock: 0.0,
            changes: vec![(f64::NEG_INFINITY, Slide::White)],
            exposed: 0,
            labels: Vec::new(),
            latest: VecDeque::new(),
            again: None,
            gain: 1.0,
            shake: 0,
        })))
    }

    /// Returns the display and the camera.
    pub fn devices(&self) -> (SimulatedDisplay, SimulatedCamera) {
        (SimulatedDisplay(self.clone()), SimulatedCamera(self.clone()))
    }

    /// Puts something else before the camera.
    pub fn set_images(&self, images: HashMap<Slide, Raw>) {
        self.0.borrow_mut().images = images;
    }

    /// From now on every frame is moved sideways by up to so many pixels: somebody holds the board.
    pub fn shake(&self, pixels: usize) {
        self.0.borrow_mut().shake = pixels;
    }

    /// Returns what the frame of this number shows: the slide, or `None` for a mixture of two.
    pub fn label(&self, frame: u64) -> Option<Slide> {
        self.0.borrow().labels[frame as usize]
    }
}

impl std::fmt::Debug for SimulatedRoom {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SimulatedRoom").field("faults", &self.0.borrow().faults).finish_non_exhaustive()
    }
}

/// The display of a [`SimulatedRoom`].
#[derive(Debug)]
pub struct SimulatedDisplay(SimulatedRoom);

/// The camera of a [`SimulatedRoom`].
#[derive(Debug)]
pub struct SimulatedCamera(SimulatedRoom);

impl Display for SimulatedDisplay {
    fn show(&mut self, slide: Slide) -> Result<Duration, CaptureError> {
        let room = &mut *self.0.0.borrow_mut();
        // Drawing and answering take their time.
        room.clock += FRAME_SECS * room.random.uniform();
        let jitter = room.faults.jitter_frames * (2.0 * room.random.uniform() - 1.0);
        let latency = (room.faults.latency_frames + jitter).max(0.0) * FRAME_SECS;
        let last = room.changes.last().map_or(0.0, |c| c.0);
        room.changes.push(((room.clock + latency).max(last), slide));
        Ok(Duration::from_secs_f64(room.clock))
    }
}

impl Camera for SimulatedCamera {
    fn next_frame(&mut self) -> Result<Frame, CaptureError> {
        let room = &mut *self.0.0.borrow_mut();
        let (label, raw) = room.deliver();
        room.labels.push(label);
        let number = room.labels.len() as u64 - 1;
        Ok(Frame { number, at: Duration::from_secs_f64(room.clock), raw })
    }
}

impl Room {
    fn deliver(&mut self) -> (Option<Slide>, Raw) {
        if let Some(again) = self.again.take() {
            return again;
        }
        loop {
            let frame = self.expose();
            self.latest.push_front(frame.clone());
            self.latest.truncate(self.faults.stale_depth + 1);
            if self.random.uniform() < self.faults.loss {
                continue;
            }
            let delivered = if self.random.uniform() < self.faults.stale && self.latest.len() > 1 {
                let back = 1 + (self.random.uniform() * (self.latest.len() - 1) as f64) as usize;
                self.latest[back.min(self.latest.len() - 1)].clone()
            } else {
                frame
            };
            if self.random.uniform() < self.faults.duplicated {
                self.again = Some(delivered.clone());
            }
            return delivered;
        }
    }

    /// Exposes the next frame, and sets the clock to when it is there.
    fn expose(&mut self) -> (Option<Slide>, Raw) {
        let start = self.exposed as f64 * FRAME_SECS;
        let end = start + EXPOSURE * FRAME_SECS;
        self.exposed += 1;
        self.clock = self.clock.max(end + 0.2 * FRAME_SECS);
        let slide_at = |t: f64| self.changes.iter().rev().find(|c| c.0 <= t).map_or(Slide::White, |c| c.1);
        let (first, last) = (slide_at(start), slide_at(end));
        let change = self.changes.iter().rev().map(|c| c.0).find(|t| *t <= end).unwrap_or(start);
        // Nobody looks further back than a camera holds frames.
        let kept = self.changes.len().saturating_sub(64);
        self.changes.drain(..kept);
        let part = ((change - start) / (end - start)).clamp(0.0, 1.0);
        let torn = self.random.uniform() < 0.5;
        let raw = self.picture(first, last, part, torn);
        ((first == last).then_some(first), raw)
    }

    /// Returns a frame that shows one slide for a `part` of the exposure, then another: in the upper and the lower part
    /// of the picture (`torn`), or one over the other.
    fn picture(&mut self, first: Slide, last: Slide, part: f64, torn: bool) -> Raw {
        let (a, b) = (codes(&self.images[&first]), codes(&self.images[&last]));
        let image = &self.images[&Slide::White];
        let (w, n) = (image.width * image.channels, image.height);
        let mix = |i: usize| match (first == last, torn) {
            (true, _) => b[i],
            (false, true) if ((i / w) as f64) < part * n as f64 => a[i],
            (false, true) => b[i],
            (false, false) => part as f32 * a[i] + (1.0 - part as f32) * b[i],
        };
        let max = image.depth().max().unwrap_or(1.0) as f32;
        let (read, shot) = (self.faults.read_noise as f32, self.faults.shot_noise as f32);
        let gain = self.gain as f32;
        let by = if self.shake == 0 { 0 } else { (self.random.uniform() * (self.shake + 1) as f64) as usize };
        let mut offset = 0;
        let mut values = Vec::with_capacity(w * n);
        for i in 0..w * n {
            if i % w == 0 {
                offset = (self.random.uniform() * self.normal.len() as f64) as usize;
            }
            let moved = i - i % w + (i % w + by * image.channels) % w;
            let light = gain * mix(moved);
            let noise = if read + shot > 0.0 { (read * read + shot * light).sqrt() } else { 0.0 };
            let value = light + noise * self.normal[(offset + i % w) % self.normal.len()];
            values.push(value.round().clamp(0.0, max));
        }
        if self.faults.automatic_exposure > 0.0 {
            let mean = values.iter().sum::<f32>() / values.len() as f32;
            let wanted = self.gain * f64::from(0.4 * max / mean.max(1.0));
            self.gain += self.faults.automatic_exposure * (wanted.clamp(0.2, 5.0) - self.gain);
        }
        let data = match &image.data {
            RawData::U8(_) => RawData::U8(values.iter().map(|v| *v as u8).collect()),
            RawData::U16(_) => RawData::U16(values.iter().map(|v| *v as u16).collect()),
            RawData::Float(_) => RawData::Float(values),
        };
        Raw { width: image.width, height: image.height, channels: image.channels, data }
    }
}

fn codes(raw: &Raw) -> Vec<f32> {
    match &raw.data {
        RawData::U8(v) => v.iter().map(|c| f32::from(*c)).collect(),
        RawData::U16(v) => v.iter().map(|c| f32::from(*c)).collect(),
        RawData::Float(v) => v.clone(),
    }
}

/// SplitMix64 (G. L. Steele, D. Lea, C. H. Flood, OOPSLA 2014, Fig. 17): small, and the same everywhere.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// By Box and Muller.
    fn normal(&mut self) -> f64 {
        let (u, v) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }
}
