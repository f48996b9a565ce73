//! What is shown of the newest frame: the surface before it carried along, then its own, then that refined.

use std::collections::VecDeque;
use std::time::Instant;

use anyhow::Result;
use nelu3d::color_field::check_mono;
use nelu3d::reconstruct::{Context, Effort, ReconstructionOptions};
use nelu3d::sequence::{FrameInput, FrameReconstruction, FrameState, Motion, MotionMode, Neighbors, reconstruct_frame};
use nelu3d::surface::{PixelStatus, SurfaceMaps, assemble, image_plane};
use nelu3d::{ColorField, Progress};
use nelu3d_capture::page::LivePage;
use nelu3d_report::{LiveSurface, live_surface};
use nelu3d_scan::rig::{Capture, Need, PatternSet, Shot};
use nelu3d_scan::{Image, Mesh, Rig};

use super::arrivals::Newest;
use crate::args::SequenceArgs;
use crate::errors::sentence;

/// Frames over which the rate is measured.
const RATE_OVER: usize = 10;

/// The page, and the frame that it shows.
pub(super) struct View<'a> {
    rig: &'a Rig,
    set: &'a PatternSet,
    field: &'a ColorField,
    args: &'a SequenceArgs,
    page: LivePage,
    /// The camera's rays: x/z and y/z per pixel.
    plane: Vec<[f32; 2]>,
    /// The frame that was shown last.
    last: Option<LastFrame>,
    /// What there is to refine of it.
    unrefined: Option<Work>,
    /// When the last frames were shown.
    times: VecDeque<Instant>,
    pub(super) counts: Counts,
}

/// What became of the frames.
#[derive(Default)]
pub(super) struct Counts {
    /// Frames that were shown.
    pub(super) shown: usize,
    /// Frames that were refined.
    pub(super) refined: usize,
    /// Frames that failed.
    pub(super) failed: usize,
    /// Frames that were left out of the view, because a newer one was there.
    pub(super) left_out: usize,
    /// Seconds from when a frame was found complete until its surface was shown.
    pub(super) late_secs: Vec<f64>,
}

/// What the next frame starts from.
struct LastFrame {
    name: String,
    white: Image,
    /// `None` if the frame failed.
    state: Option<FrameState>,
}

/// A frame's images, and what its surface starts from.
struct Work {
    newest: Newest,
    capture: Capture,
    neighbors: Neighbors,
    state: Option<FrameState>,
}

impl<'a> View<'a> {
    /// Shows nothing yet.
    pub(super) fn new(
        rig: &'a Rig,
        set: &'a PatternSet,
        field: &'a ColorField,
        args: &'a SequenceArgs,
        page: LivePage,
    ) -> Self {
        let (plane, times, counts) = (image_plane(&rig.camera), VecDeque::new(), Counts::default());
        Self { rig, set, field, args, page, plane, last: None, unrefined: None, times, counts }
    }

    /// Shows a frame: the surface before it where that has moved to, then its own after few steps. A frame that fails
    /// says so on the page, and the next one begins anew.
    pub(super) fn show(&mut self, newest: Newest, quiet: &Progress) {
        if self.last.is_some() {
            self.counts.left_out += newest.new - 1;
        }
        self.unrefined = None;
        if let Err(e) = self.try_to_show(newest.clone(), quiet)
            && !quiet.cancelled()
        {
            self.counts.failed += 1;
            self.publish(&newest, "failed", &sentence(&e), None);
            if let Some(last) = &mut self.last {
                last.state = None;
            }
        }
    }

    fn try_to_show(&mut self, newest: Newest, quiet: &Progress) -> Result<()> {
        let capture = self.rig.read_shot(&newest.frame, self.set, Need::Frame)?;
        check_mono(&capture, self.set, &newest.frame, self.field)?;
        let (neighbors, state) = self.before(&newest, &capture.white);
        if let Some(state) = &state
            && let Some(motion) = neighbors.motion(&capture.white)
        {
            let mesh = self.mesh(motion.warp_depth(&state.depth, 0.0), &capture.white);
            self.publish(&newest, "carried", "", Some(&mesh));
        }
        let work = Work { newest, capture, neighbors, state };
        let few = ReconstructionOptions { effort: Effort::Quick, ..self.args.options.clone() };
        let result = self.reconstruct(&work, &few, quiet)?;
        self.counts.shown += 1;
        self.counts.late_secs.push(work.newest.at.elapsed().as_secs_f64());
        self.times.push_back(Instant::now());
        if self.times.len() > RATE_OVER {
            self.times.pop_front();
        }
        self.publish(&work.newest, "first", &verdict(&result), Some(&result.surface.mesh));
        let (name, white) = (work.newest.frame.name.clone(), work.capture.white.clone());
        self.last = Some(LastFrame { name, white, state: Some(result.state()) });
        self.unrefined = Some(work);
        Ok(())
    }

    /// Returns whether the surface of the frame that is shown can be refined.
    pub(super) fn can_refine(&self) -> bool {
        self.unrefined.is_some()
    }

    /// Refines the surface of the frame that is shown, once. The work ends early, and changes nothing, when `quiet`
    /// says so.
    pub(super) fn refine(&mut self, quiet: &Progress) {
        let Some(work) = self.unrefined.take() else { return };
        match self.reconstruct(&work, &self.args.options, quiet) {
            Ok(result) => {
                self.counts.refined += 1;
                self.publish(&work.newest, "refined", &verdict(&result), Some(&result.surface.mesh));
                if let Some(last) = &mut self.last {
                    last.state = Some(result.state());
                }
            }
            // A newer frame came, or the program ends.
            Err(_) if quiet.cancelled() => {}
            Err(e) => self.publish(&work.newest, "failed", &sentence(&e), None),
        }
    }

    /// Returns the white image before a frame's and the surface that was shown last, where it was then. Where frames
    /// were left out, that surface is carried along over all of them at once.
    fn before(&self, newest: &Newest, white: &Image) -> (Neighbors, Option<FrameState>) {
        let state = || self.last.as_ref().and_then(|last| last.state.clone());
        if self.args.motion.motion == MotionMode::Off {
            return (Neighbors::default(), state());
        }
        let last = self.last.as_ref();
        let between = newest.before.as_ref().filter(|shot| last.is_none_or(|last| last.name != shot.name));
        let read = |shot: &Shot| self.rig.reader(shot).read(&self.rig.white).ok();
        match (between.and_then(read), last) {
            // Nothing was shown yet: its neighbor alone tells how it moves.
            (between, None) => (Neighbors::new(between, None), None),
            (None, Some(last)) => (Neighbors::new(Some(last.white.clone()), None), state()),
            (Some(between), Some(last)) if same_size(&between, white) => {
                let motion = Motion::around(Some(&last.white), &between, None);
                let depth =
                    |depth: Vec<f32>| motion.as_ref().map_or_else(|| depth.clone(), |m| m.warp_depth(&depth, 0.0));
                let state = state().map(|s| FrameState { depth: depth(s.depth), ..s });
                (Neighbors::new(Some(between), None), state)
            }
            (Some(_), Some(last)) => (Neighbors::new(Some(last.white.clone()), None), state()),
        }
    }

    fn reconstruct(
        &self,
        work: &Work,
        options: &ReconstructionOptions,
        quiet: &Progress,
    ) -> Result<FrameReconstruction> {
        let input = FrameInput {
            state: work.state.as_ref(),
            neighbors: &work.neighbors,
            rig: self.rig,
            field: self.field,
            options,
            motion: &self.args.motion,
        };
        Ok(reconstruct_frame(&input, work.capture.clone(), Context::new(quiet, options.device)?)?)
    }

    /// Returns the mesh of a depth map alone.
    fn mesh(&self, depth: Vec<f32>, white: &Image) -> Mesh {
        let n = depth.len();
        let unknown = || vec![f32::NAN; n];
        let status = vec![PixelStatus::Valid; n];
        let maps = SurfaceMaps { depth, sigma: unknown(), status, residual: unknown(), ambient: unknown() };
        assemble(maps, &self.rig.camera, &self.plane, white).mesh
    }

    fn publish(&self, newest: &Newest, stage: &'static str, message: &str, mesh: Option<&Mesh>) {
        let over = self.times.front().zip(self.times.back()).map(|(first, last)| (*last - *first).as_secs_f64());
        let about = LiveSurface {
            frame: &newest.frame.name,
            stage,
            rate: over.filter(|secs| *secs > 0.0).map(|secs| (self.times.len() - 1) as f64 / secs),
            late_secs: newest.at.elapsed().as_secs_f64(),
            left_out: self.counts.left_out,
            message,
        };
        self.page.publish(live_surface(&about, mesh));
    }

    /// Returns the page's address.
    pub(super) fn address(&self) -> &str {
        self.page.address()
    }
}

/// Returns what is said of a surface.
fn verdict(result: &FrameReconstruction) -> String {
    format!("verdict: {}", result.diagnostics.reconstruction.judgment.line())
}

fn same_size(a: &Image, b: &Image) -> bool {
    [a.width, a.height] == [b.width, b.height]
}
