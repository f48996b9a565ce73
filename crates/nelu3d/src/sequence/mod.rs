//! Scenes that move: each frame from the one before, and the flash drawn as it was when the pattern was taken.
//!
//! A sequence falls into stretches that begin with a keyframe, a frame that knows nothing of the one before. Every other frame depends on
//! what the frame before it left ([`Memory`]) and on the flashes of its two neighbors, and on nothing else: a stretch gives the same
//! whether it is computed alone, in one go, or with interruptions.

mod flow;
pub mod motion;
mod plan;

use std::sync::OnceLock;

use nelu3d_scan::rig::Capture;
use nelu3d_scan::{Camera, Image};
use serde::{Deserialize, Serialize};
use serde_json::json;

use self::motion::{Motion, PatternTime, between, pattern_time};
pub use self::plan::{Plan, Shard};
use crate::color_field::ColorField;
use crate::progress::Progress;
use crate::reconstruct::lookup::Rays;
use crate::reconstruct::{Before, Effort, Failure, Mixing, Options, Recipe, paper, reconstruct, reconstruct_after};
use crate::result::{Reconstruction, StageClock};

/// What is done about motion between a pattern and its flash.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum MotionMode {
    /// The flash is drawn as it was at the pattern's time, which is found with the surface
    #[default]
    Auto,
    /// The flash is a mean of this frame's and the one before it (or after it)
    Interpolate,
    /// Pattern and flash are taken to show the same
    Off,
}

/// Settings of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct MotionOptions {
    /// What to do about motion between a pattern and its flash
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = MotionMode::Auto))]
    pub motion: MotionMode,
    /// When patterns are taken, in frames from their flash (negative: before it). Without it, `auto` finds it and `interpolate`
    /// takes -0.5
    #[cfg_attr(feature = "clap", arg(long, value_name = "FRAMES", allow_negative_numbers = true))]
    pub pattern_time: Option<f32>,
}

/// What a frame leaves for the next.
#[derive(Clone, Debug)]
pub struct Memory {
    /// Camera z per pixel, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// When patterns were taken, if that is known.
    pub pattern_time: Option<PatternTime>,
    /// How the camera mixes the light's colors, if that is known.
    pub mixing: Option<Mixing>,
}

impl Memory {
    /// Of a result, from its maps and its `method` record.
    pub fn of(depth: Vec<f32>, info: &serde_json::Map<String, serde_json::Value>) -> Self {
        fn read<T: serde::de::DeserializeOwned>(value: Option<&serde_json::Value>) -> Option<T> {
            value.and_then(|v| serde_json::from_value(v.clone()).ok())
        }
        let pattern_time = read(info.get("motion").and_then(|m| m.get("pattern_time")));
        Self { depth, pattern_time, mixing: read(info.get("mixing")) }
    }
}

/// Flashes of the frames before and after.
#[derive(Default)]
pub struct Neighbors {
    before: Option<Image>,
    after: Option<Image>,
    motion: OnceLock<Option<Motion>>,
}

impl Neighbors {
    /// Of the frame before and the frame after; `None` at the ends of a sequence.
    pub fn new(before: Option<Image>, after: Option<Image>) -> Self {
        Self { before, after, motion: OnceLock::new() }
    }

    /// How the points of the flash `taken` between them move; `None` if neither neighbor tells. It takes nothing but flashes, so a caller may
    /// find it while the frame before is computed: it is found once, at the first call.
    pub fn motion(&self, taken: &Image) -> Option<&Motion> {
        self.motion.get_or_init(|| Motion::around(self.before.as_ref(), taken, self.after.as_ref())).as_ref()
    }
}

/// Speeds below this do not tell when a pattern was taken, px per frame.
const STILL_PX: f32 = 0.2;

/// Below that speed, a time that explains less than this of the misfit is none.
const TELLING: f32 = 0.02;

/// A flash drawn at the pattern's time that explains this much less than the one that was taken is wrong.
const HARMFUL: f32 = -0.02;

/// Reconstructs one frame. `memory` is what the frame before left; a keyframe has none. Frames of recipe `paper` always begin anew.
///
/// # Errors
///
/// Every pixel was left out, or the user stopped it.
#[allow(clippy::too_many_arguments)]
pub fn frame(
    memory: Option<&Memory>,
    mut capture: Capture,
    neighbors: &Neighbors,
    camera: &Camera,
    field: &ColorField,
    opts: &Options,
    motion: &MotionOptions,
    progress: &Progress,
    clock: &mut StageClock<'_>,
) -> Result<Reconstruction, Failure> {
    let taken = capture.white.clone();
    let mut found = None;
    let auto = motion.motion == MotionMode::Auto;
    if motion.motion == MotionMode::Interpolate {
        let time = motion.pattern_time.unwrap_or(-0.5);
        let other = if time <= 0.0 { &neighbors.before } else { &neighbors.after };
        if let Some(other) = other {
            capture.white = between(&taken, other, time.abs().min(1.0));
        }
    }
    // The surface of the frame before moves along with what is seen, whatever is done about the flash.
    let seen = (auto || memory.is_some()).then(|| {
        clock.begin("find the motion");
        neighbors.motion(&taken)
    });
    let seen = seen.flatten();
    let lit = |i: usize| capture_light(&taken, i) > 0.02;
    let speed = seen.map_or(0.0, |s| s.median_px(lit));
    let moving = seen.filter(|seen| speed >= STILL_PX || seen.tells_light());
    if let Some(moving) = moving.filter(|_| auto) {
        let known = motion.pattern_time.map(|frames| PatternTime { frames, explained: 0.0 });
        found = known.or(memory.and_then(|m| m.pattern_time));
        if found.is_none() {
            // A first surface, of pattern and flash as they were taken, tells the time.
            let first = Options { effort: Effort::Quick, steps: None, recipe: Recipe::Fast, ..opts.clone() };
            let surface = reconstruct(&capture, camera, field, &first, progress, clock, None)?;
            clock.begin("find the motion");
            found = pattern_time(moving, None, &capture, &surface.depth, &Rays::new(camera, field, 1), field);
            found = found.filter(|t| speed >= STILL_PX || t.explained >= TELLING);
        }
        if let Some(time) = found {
            capture.white = moving.flash_at(&taken, time.frames);
        }
    }
    let time = found.map_or(0.0, |t| t.frames);
    let before = memory.map(|m| {
        let depth = moving.map_or_else(|| m.depth.clone(), |moving| moving.carried(&m.depth, time));
        Before { depth, mixing: m.mixing }
    });
    let run = |capture: &Capture, clock: &mut StageClock<'_>| match opts.recipe {
        Recipe::Fast => reconstruct_after(before.as_ref(), capture, camera, field, opts, progress, clock, None),
        Recipe::Paper => paper::reconstruct(capture, camera, field, opts, progress, clock, None),
    };
    let mut out = run(&capture, clock)?;
    if let (Some(moving), None, true) = (moving, motion.pattern_time, auto) {
        // Once more with the better surface: what the next frame begins with.
        clock.begin("find the motion");
        capture.white = taken;
        let near = found.map(|t| t.frames);
        let better = pattern_time(moving, near, &capture, &out.depth, &Rays::new(camera, field, 1), field);
        if better.is_some_and(|t| t.explained < HARMFUL) {
            // What was seen of motion is none: pattern and flash are believed as they were taken.
            out = run(&capture, clock)?;
            found = None;
        } else {
            // What hardly moves says little about when.
            let tells = |t: &PatternTime| speed >= STILL_PX || t.explained >= TELLING;
            found = better.filter(tells).or(found);
        }
    }
    // A frame that stands still hands on what it was told.
    let time = found.or(memory.and_then(|m| m.pattern_time));
    out.info.insert("motion".into(), json!({ "settings": motion, "speed_px": speed, "pattern_time": time }));
    Ok(out)
}

/// Mean over channels.
fn capture_light(image: &Image, i: usize) -> f32 {
    let c = image.channels;
    image.data[i * c..(i + 1) * c].iter().sum::<f32>() / c as f32
}
