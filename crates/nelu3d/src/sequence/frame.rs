//! One frame of a sequence.

use nelu3d_scan::rig::Capture;
use nelu3d_scan::{Camera, Image};

use super::motion::{Motion, PatternTime, blend_white, pattern_time};
use super::neighbors::Neighbors;
use super::options::{MotionMode, MotionOptions};
use super::state::{FrameDiagnostics, FrameState, MotionDiagnostics};
use crate::color_field::{CameraRays, ColorField};
use crate::progress::StageTime;
use crate::reconstruct::{
    Context, Diagnostics, Effort, Failure, PreviousFrame, Recipe, ReconstructionOptions, reconstruct_capture,
};
use crate::surface::Surface;

/// Speed below which motion does not tell when a pattern was taken, px per frame.
const STILL_PX: f32 = 0.2;

/// Least part of the misfit that a time must explain to be accepted below that speed.
const MIN_EXPLAINED: f32 = 0.02;

/// A white image at the pattern's time that explains this much less than the one that was taken is wrong.
const HARMFUL: f32 = -0.02;

/// What a frame is reconstructed from.
#[derive(Clone, Copy)]
pub struct FrameInput<'a> {
    /// What the previous frame left; `None` for a keyframe.
    pub state: Option<&'a FrameState>,
    /// White images of the neighboring frames.
    pub neighbors: &'a Neighbors,
    /// The camera.
    pub camera: &'a Camera,
    /// The color field.
    pub field: &'a ColorField,
    /// Settings of the reconstruction.
    pub options: &'a ReconstructionOptions,
    /// What to do about motion.
    pub motion: &'a MotionOptions,
}

/// A reconstructed frame.
#[derive(Clone, Debug)]
pub struct FrameReconstruction {
    /// The surface.
    pub surface: Surface,
    /// What the method puts on record.
    pub diagnostics: FrameDiagnostics,
    /// Wall and CPU time of each stage, in order.
    pub stages: Vec<StageTime>,
}

impl FrameReconstruction {
    /// What the next frame starts from.
    pub fn state(&self) -> FrameState {
        FrameState {
            depth: self.surface.depth.clone(),
            pattern_time: self.diagnostics.motion.pattern_time,
            crosstalk: self.diagnostics.reconstruction.crosstalk(),
        }
    }
}

/// Reconstructs one frame. Frames of recipe `paper` always begin anew.
///
/// # Errors
///
/// Every pixel was rejected, or the caller stopped the work.
pub fn reconstruct_frame(
    input: &FrameInput<'_>,
    mut capture: Capture,
    mut cx: Context<'_>,
) -> Result<FrameReconstruction, Failure> {
    let taken = capture.white.clone();
    let auto = input.motion.motion == MotionMode::Auto;
    if input.motion.motion == MotionMode::Interpolate {
        let time = input.motion.pattern_time.unwrap_or(-0.5);
        let other = if time <= 0.0 { &input.neighbors.before } else { &input.neighbors.after };
        if let Some(other) = other {
            capture.white = blend_white(&taken, other, time.abs().min(1.0));
        }
    }
    // The surface of the previous frame moves along with the image, whatever is done about the white image.
    let seen = if auto || input.state.is_some() {
        cx.clock.begin("find the motion");
        input.neighbors.motion(&taken)
    } else {
        None
    };
    let speed = seen.map_or(0.0, |s| s.median_px(|i| mean_over_channels(&taken, i) > 0.02));
    let moving = seen.filter(|seen| speed >= STILL_PX || seen.tells_light());
    let mut found = None;
    if let Some(moving) = moving.filter(|_| auto) {
        found = first_pattern_time(input, moving, speed, &capture, &mut cx)?;
        if let Some(time) = found {
            capture.white = moving.flash_at(&taken, time.frames);
        }
    }
    let time = found.map_or(0.0, |t| t.frames);
    let previous = input.state.map(|state| PreviousFrame {
        depth: moving.map_or_else(|| state.depth.clone(), |moving| moving.carried(&state.depth, time)),
        crosstalk: state.crosstalk,
    });
    let mut out = run(input, previous.as_ref(), &capture, &mut cx)?;
    if let (Some(moving), None, true) = (moving, input.motion.pattern_time, auto) {
        // Once more with the better surface: what the next frame begins with.
        cx.clock.begin("find the motion");
        capture.white = taken;
        let rays = CameraRays::new(input.camera, input.field, 1);
        let better = pattern_time(moving, found.map(|t| t.frames), &capture, &out.0.depth, &rays, input.field);
        if better.is_some_and(|t| t.explained < HARMFUL) {
            // What looked like motion is none: pattern and white image are believed as they were taken.
            out = run(input, previous.as_ref(), &capture, &mut cx)?;
            found = None;
        } else {
            found = better.filter(|t| tells(speed, t)).or(found);
        }
    }
    // A frame that stands still hands on what it was told.
    let pattern_time = found.or(input.state.and_then(|s| s.pattern_time));
    let motion = MotionDiagnostics { settings: input.motion.clone(), speed_px: speed, pattern_time };
    let (surface, reconstruction) = out;
    let diagnostics = FrameDiagnostics { reconstruction, motion };
    Ok(FrameReconstruction { surface, diagnostics, stages: cx.finish() })
}

/// Whether a pattern time is believed: what hardly moves says little about when.
fn tells(speed: f32, time: &PatternTime) -> bool {
    speed >= STILL_PX || time.explained >= MIN_EXPLAINED
}

/// When this frame's patterns were taken: as asked, as the previous frame found, or as a quick surface of pattern and white
/// image as they were taken tells.
fn first_pattern_time(
    input: &FrameInput<'_>,
    moving: &Motion,
    speed: f32,
    capture: &Capture,
    cx: &mut Context<'_>,
) -> Result<Option<PatternTime>, Failure> {
    let known = input.motion.pattern_time.map(|frames| PatternTime { frames, explained: 0.0 });
    if let Some(time) = known.or(input.state.and_then(|s| s.pattern_time)) {
        return Ok(Some(time));
    }
    let quick =
        ReconstructionOptions { effort: Effort::Quick, steps: None, recipe: Recipe::Fast, ..input.options.clone() };
    let (surface, _) = reconstruct_capture(capture, input.camera, input.field, None, &quick, cx)?;
    cx.clock.begin("find the motion");
    let rays = CameraRays::new(input.camera, input.field, 1);
    let found = pattern_time(moving, None, capture, &surface.depth, &rays, input.field);
    Ok(found.filter(|t| tells(speed, t)))
}

fn run(
    input: &FrameInput<'_>,
    previous: Option<&PreviousFrame>,
    capture: &Capture,
    cx: &mut Context<'_>,
) -> Result<(Surface, Diagnostics), Failure> {
    reconstruct_capture(capture, input.camera, input.field, previous, input.options, cx)
}

/// Mean over the channels of pixel `i`.
fn mean_over_channels(image: &Image, i: usize) -> f32 {
    let c = image.channels;
    image.data[i * c..(i + 1) * c].iter().sum::<f32>() / c as f32
}
