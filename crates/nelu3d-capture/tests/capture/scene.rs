//! What a camera under test looks at: a display whose slides are seen late, and noise.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use nelu3d_capture::{Camera, CaptureError, CaptureSession, Display, Frame, Slide};
use nelu3d_scan::image::{Raw, RawData};

/// Columns and rows of a picture.
pub(crate) const SIZE: [usize; 2] = [160, 120];
/// Time from one frame to the next.
pub(crate) const FRAME: Duration = Duration::from_millis(20);

/// A display, seen through a delay.
pub(crate) struct Scene {
    clock: Instant,
    /// From the display's word to the change in the picture.
    latency: Duration,
    /// When which slide comes to be seen.
    changes: Vec<(Duration, Slide)>,
    random: u64,
}

/// Code of a pixel under a slide, of 255.
fn code(slide: Slide, x: usize, y: usize) -> f64 {
    let surface = 200.0 * (1.0 - 0.4 * y as f64 / SIZE[1] as f64);
    let part = match slide {
        Slide::White => 1.0,
        Slide::Black => 0.0,
        Slide::Pattern(i) => 0.5 + 0.5 * (x as f64 / (5.0 + 3.0 * i as f64)).sin(),
    };
    8.0 + surface * part
}

impl Scene {
    /// Returns a scene that shows white.
    pub(crate) fn new(latency: Duration) -> Arc<Mutex<Self>> {
        let changes = vec![(Duration::ZERO, Slide::White)];
        Arc::new(Mutex::new(Self { clock: Instant::now(), latency, changes, random: 7 }))
    }

    /// Returns the display's clock.
    pub(crate) fn clock(&self) -> Instant {
        self.clock
    }

    /// Returns a number from 0 to 1.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.random = self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.random >> 33) as f64 / (1u64 << 31) as f64
    }

    /// Returns what is seen now, with noise: codes of 255, row after row.
    pub(crate) fn codes(&mut self) -> Vec<f64> {
        let now = self.clock.elapsed();
        let slide = self.changes.iter().rev().find(|c| c.0 <= now).map_or(Slide::White, |c| c.1);
        let mut codes = Vec::with_capacity(SIZE[0] * SIZE[1]);
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let noise = self.uniform() + self.uniform() + self.uniform() - 1.5;
                codes.push(code(slide, x, y) + 3.0 * noise);
            }
        }
        codes
    }
}

/// The display of a scene.
pub(crate) struct Shown(pub(crate) Arc<Mutex<Scene>>);

impl Display for Shown {
    fn show(&mut self, slide: Slide) -> Result<Duration, CaptureError> {
        let mut scene = self.0.lock().unwrap();
        let now = scene.clock.elapsed();
        let seen = now + scene.latency;
        scene.changes.push((seen, slide));
        Ok(now)
    }
}

/// Fails unless a frame shows a slide: codes of 8 bits, or of 12.
pub(crate) fn assert_shows(frame: &Frame, slide: Slide, of: &str) {
    let raw: &Raw = &frame.raw;
    assert_eq!([raw.width, raw.height], SIZE);
    let codes: Vec<f64> = match &raw.data {
        RawData::U8(codes) => codes.iter().map(|c| f64::from(*c)).collect(),
        RawData::U16(codes) => codes.iter().map(|c| f64::from(*c) / 16.0).collect(),
        _ => panic!("neither 8 bits nor 12"),
    };
    let expected = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| code(slide, x, y)));
    let off = codes.iter().zip(expected).map(|(c, e)| (c - e).abs()).sum::<f64>() / codes.len() as f64;
    assert!(off < 2.0, "{slide:?} is off by {off} codes: {of}");
}

/// Takes images of a scene with a camera, and fails unless each shows what was asked.
pub(crate) fn assert_every_image_shows_what_was_asked(scene: &Arc<Mutex<Scene>>, camera: &mut dyn Camera) {
    let latency = scene.lock().unwrap().latency;
    let mut display = Shown(scene.clone());
    let mut session = CaptureSession::start(&mut display, camera).unwrap();
    let found = session.timing();
    assert!((found.frame_secs - FRAME.as_secs_f64()).abs() < 0.01, "{found:?}");
    assert!(found.latency_max_secs > latency.as_secs_f64(), "{found:?}");
    for _ in 0..3 {
        let images = session.take(8).unwrap();
        let taken = [(Slide::White, &images.white), (Slide::Black, &images.black)];
        let patterns = images.patterns.iter().enumerate().map(|(i, f)| (Slide::Pattern(i), f));
        for (slide, frame) in taken.into_iter().chain(patterns) {
            assert_shows(frame, slide, &format!("latency {latency:?}"));
        }
    }
}
