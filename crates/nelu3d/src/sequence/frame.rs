//! One frame of a sequence.

use std::borrow::Cow;

use nelu3d_scan::rig::Capture;
use nelu3d_scan::{Image, Rig};

use super::motion::Motion;
use super::neighbors::Neighbors;
use super::options::{MotionMode, MotionOptions};
use super::pattern_time::{PatternTime, PatternTimeProblem};
use super::state::{FrameDiagnostics, FrameState, MotionDiagnostics};
use super::white_blend::blend_white;
use crate::color_field::ColorField;
use crate::drift::check_frame;
use crate::progress::StageTime;
use crate::reconstruct::{
    Context, Diagnostics, Effort, Failure, PreviousFrame, Recipe, ReconstructionOptions, reconstruct_capture,
};
use crate::surface::Surface;

/// Median speed below which motion does not tell when a pattern was taken, px per frame.
const STILL_PX: f32 = 0.2;

/// Fraction of χ² that a time must explain to be accepted below that speed.
const MIN_EXPLAINED: f32 = 0.02;

/// Explained fraction of χ² below which a white image at the pattern's time is worse than the one that was taken.
const HARMFUL: f32 = -0.02;

/// Mean intensity above which a pixel counts for the speed.
const MIN_LIT: f32 = 0.02;

/// Time of the patterns that interpolation assumes, frames from their white image.
const DEFAULT_PATTERN_TIME: f32 = -0.5;

/// The input of a frame's reconstruction, besides its capture.
#[derive(Clone, Copy)]
pub struct FrameInput<'a> {
    /// The state that the previous frame left; `None` for a keyframe.
    pub state: Option<&'a FrameState>,
    /// White images of the neighboring frames.
    pub neighbors: &'a Neighbors,
    /// The rig: its camera, and its board, which may be in view.
    pub rig: &'a Rig,
    /// The color field.
    pub field: &'a ColorField,
    /// Settings of the reconstruction.
    pub options: &'a ReconstructionOptions,
    /// Settings of motion between a pattern and its white image.
    pub motion: &'a MotionOptions,
}

/// A reconstructed frame.
#[derive(Clone, Debug)]
pub struct FrameReconstruction {
    /// The surface.
    pub surface: Surface,
    /// Diagnostics of the frame.
    pub diagnostics: FrameDiagnostics,
    /// Wall and CPU time of each stage, in order.
    pub stages: Vec<StageTime>,
}

impl FrameReconstruction {
    /// Returns the state that the next frame starts from.
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
    cx.clock.begin("look for drift");
    let drift = check_frame(input.rig, &capture, &input.neighbors.whites(), input.field);
    let taken = capture.white.clone();
    let auto = input.motion.motion == MotionMode::Auto;
    if input.motion.motion == MotionMode::Interpolate {
        interpolate_white(input, &mut capture);
    }
    // The surface of the previous frame moves along with the image, whatever is done about the white image.
    let motion = if auto || input.state.is_some() {
        cx.clock.begin("find the motion");
        input.neighbors.motion(&taken)
    } else {
        None
    };
    let speed = motion.map_or(0.0, |m| m.median_px(|i| mean_over_channels(&taken, i) > MIN_LIT));
    let motion = motion.filter(|m| speed >= STILL_PX || m.has_brightness());
    let mut found = None;
    if let Some(motion) = motion.filter(|_| auto) {
        found = first_pattern_time(input, motion, speed, &capture, &mut cx)?;
        if let Some(time) = found {
            capture.white = motion.white_at(&taken, time.frames);
        }
    }
    let time = found.map_or(0.0, |t| t.frames);
    let previous = input.state.map(|state| PreviousFrame {
        depth: motion.map_or_else(|| state.depth.clone(), |motion| motion.warp_depth(&state.depth, time)),
        crosstalk: state.crosstalk,
    });
    let mut out = run(input, previous.as_ref(), &capture, &mut cx)?;
    if let (Some(motion), None, true) = (motion, input.motion.pattern_time, auto) {
        // Once more with the better surface: what the next frame begins with.
        cx.clock.begin("find the motion");
        capture.white = taken;
        let better = solve_pattern_time(input, motion, found.map(|t| t.frames), &capture, &out.0.depth);
        if better.is_some_and(|t| t.explained < HARMFUL) {
            // What looked like motion is none: pattern and white image are believed as they were taken.
            out = run(input, previous.as_ref(), &capture, &mut cx)?;
            found = None;
        } else {
            found = better.filter(|t| is_credible(speed, t)).or(found);
        }
    }
    // A frame that stands still hands on the time that it started from.
    let pattern_time = found.or(input.state.and_then(|s| s.pattern_time));
    let motion = MotionDiagnostics { settings: input.motion.clone(), speed_px: speed, pattern_time };
    let (surface, mut reconstruction) = out;
    reconstruction.add_drift(drift);
    let diagnostics = FrameDiagnostics { reconstruction, motion };
    Ok(FrameReconstruction { surface, diagnostics, stages: cx.finish() })
}

/// Replaces the white image by its mean with the previous or the next frame's, weighted by the pattern's time.
fn interpolate_white(input: &FrameInput<'_>, capture: &mut Capture) {
    let time = input.motion.pattern_time.unwrap_or(DEFAULT_PATTERN_TIME);
    let other = if time <= 0.0 { &input.neighbors.before } else { &input.neighbors.after };
    if let Some(other) = other {
        capture.white = blend_white(&capture.white, other, time.abs().min(1.0));
    }
}

/// Estimates when the patterns of a capture were taken from a surface, camera z per pixel, mm.
fn solve_pattern_time(
    input: &FrameInput<'_>,
    motion: &Motion,
    near: Option<f32>,
    capture: &Capture,
    depth: &[f32],
) -> Option<PatternTime> {
    PatternTimeProblem { motion, capture, depth, camera: &input.rig.camera, field: input.field }.solve(near)
}

/// Returns whether a pattern time is credible: a scene that hardly moves determines no time.
fn is_credible(speed: f32, time: &PatternTime) -> bool {
    speed >= STILL_PX || time.explained >= MIN_EXPLAINED
}

/// Returns when this frame's patterns were taken: as asked, as the previous frame found, or as it follows from a quick
/// surface of pattern and white image as they were taken.
fn first_pattern_time(
    input: &FrameInput<'_>,
    motion: &Motion,
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
    let (surface, _) = reconstruct_capture(Cow::Borrowed(capture), &input.rig.camera, input.field, None, &quick, cx)?;
    cx.clock.begin("find the motion");
    let found = solve_pattern_time(input, motion, None, capture, &surface.depth);
    Ok(found.filter(|t| is_credible(speed, t)))
}

/// Reconstructs a capture with the settings of a frame.
fn run(
    input: &FrameInput<'_>,
    previous: Option<&PreviousFrame>,
    capture: &Capture,
    cx: &mut Context<'_>,
) -> Result<(Surface, Diagnostics), Failure> {
    reconstruct_capture(Cow::Borrowed(capture), &input.rig.camera, input.field, previous, input.options, cx)
}

/// Returns the mean over the channels of pixel `i`.
fn mean_over_channels(image: &Image, i: usize) -> f32 {
    let c = image.channels;
    image.data[i * c..(i + 1) * c].iter().sum::<f32>() / c as f32
}
