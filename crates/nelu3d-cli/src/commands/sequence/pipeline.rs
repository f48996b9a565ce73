//! The pipeline of a sequence: while a frame is computed, the next one is read and the one before is written.

use std::collections::BTreeMap;
use std::sync::mpsc::Receiver;
use std::thread::ScopedJoinHandle;

use anyhow::{Context as _, Result};
use nelu3d::color_field::check_mono;
use nelu3d::reconstruct::Context as ReconstructionContext;
use nelu3d::result::{self, ExtraFiles, Input, ResultMetadata, Summary};
use nelu3d::sequence::{FrameInput, FrameReconstruction, FrameState, Plan, reconstruct_frame};
use nelu3d::{ColorField, Progress};
use nelu3d_evaluate::{EvaluatedMaps, GroundTruth, evaluate};
use nelu3d_field::device::Device;
use nelu3d_scan::Rig;
use nelu3d_scan::output::OutputDir;
use nelu3d_scan::rig::{PatternSet, Shot};

use super::folder::SequenceFolder;
use super::read_ahead::{ReadAhead, ReadFrame};
use crate::args::SequenceArgs;
use crate::context::CommandContext;
use crate::errors::sentence;
use crate::verdict;

/// Everything that stays the same from frame to frame.
pub(super) struct SequenceRun<'a> {
    /// The rig.
    pub(super) rig: &'a Rig,
    /// The pattern set.
    pub(super) set: &'a PatternSet,
    /// The frames, in order.
    pub(super) frames: Vec<Shot>,
    /// The color field.
    pub(super) field: ColorField,
    /// Files that all frames are made from, hashed.
    pub(super) inputs: Vec<Input>,
    /// What was typed.
    pub(super) args: &'a SequenceArgs,
    /// Which frames are keyframes.
    pub(super) plan: Plan,
    /// Where results go.
    pub(super) folder: SequenceFolder,
}

/// A frame that is computed and not yet on disk.
struct ComputedFrame {
    frame: usize,
    result: FrameReconstruction,
    truth: Option<GroundTruth>,
    /// The files of its capture, hashed.
    inputs: Vec<Input>,
    output: OutputDir,
}

impl SequenceRun<'_> {
    /// Computes the frames of this part that are not there yet. Returns those that failed, and why.
    pub(super) fn all(&self, context: &CommandContext) -> Result<Vec<(String, String)>> {
        let part = self.args.shard.map_or(0..self.plan.frames, |s| self.plan.part(s));
        let quiet = context.silent();
        let on_device = !Device::or_cpu(self.args.options.device).is_cpu();
        let mut failed = Vec::new();
        let todo: Vec<usize> = part.filter(|i| !self.folder.is_done(&self.frames[*i])).collect();
        if todo.len() < self.plan.frames {
            context.progress.stage(&format!("{} of {} frames to do", todo.len(), self.plan.frames));
        }
        let ahead = ReadAhead {
            rig: self.rig,
            set: self.set,
            frames: &self.frames,
            plan: self.plan,
            motion: self.args.motion.motion,
            with_truth: self.args.truth,
            whites: BTreeMap::new(),
        };
        std::thread::scope(|scope| {
            // Nothing is kept on the way: a frame is handed over, or the reader waits with it.
            let (to, read) = std::sync::mpsc::sync_channel(0);
            let (numbers, progress) = (&todo, &quiet);
            scope.spawn(move || ahead.run(numbers, &to, progress));
            let mut writing: Option<(usize, ScopedJoinHandle<'_, Result<()>>)> = None;
            let mut before = None;
            let mut early: Option<ScopedJoinHandle<'_, Result<ComputedFrame>>> = None;
            for (done, &i) in todo.iter().enumerate() {
                context.stop_if_asked()?;
                context.progress.stage(&format!("frame {}", self.frames[i].name));
                context.progress.tick(done, todo.len());
                let state = before.take().filter(|(frame, _)| frame + 1 == i).map(|(_, state)| state);
                let begun = early.take();
                let own = if begun.is_none() { Some(receive(i, &read)?) } else { None };
                // A keyframe needs nothing of the frame before it: its cost volume is on the device while that one is
                // refined here.
                if let Some(&next) = todo.get(done + 1).filter(|next| on_device && self.plan.is_key(**next)) {
                    let frame = receive(next, &read)?;
                    early = Some(scope.spawn(move || self.compute(next, None, frame, progress)));
                }
                let computed = match (begun, own) {
                    (Some(begun), _) => joined(begun),
                    (None, Some(frame)) => self.compute(i, state, frame, progress),
                    (None, None) => unreachable!("a frame is received before it is computed"),
                };
                // Frames appear in their order: a kill leaves none that the one before it is missing for.
                if let Some((frame, written)) = writing.take() {
                    self.settle(frame, joined(written), &mut failed, context)?;
                }
                match computed {
                    Ok(computed) => {
                        before = Some((i, computed.result.state()));
                        writing = Some((i, scope.spawn(move || self.write(computed))));
                    }
                    Err(e) => self.settle(i, Err(e), &mut failed, context)?,
                }
            }
            if let Some((frame, written)) = writing {
                self.settle(frame, joined(written), &mut failed, context)?;
            }
            Ok(failed)
        })
    }

    /// Notes how a frame ended.
    fn settle(
        &self,
        frame: usize,
        outcome: Result<()>,
        failed: &mut Vec<(String, String)>,
        context: &CommandContext,
    ) -> Result<()> {
        let Err(e) = outcome else { return Ok(()) };
        // Ctrl-C is not the frame's fault; a full disk is, but also that of every other frame.
        context.stop_if_asked()?;
        let (frame, why) = (&self.frames[frame], sentence(&e));
        context.progress.warn(format!("frame {}: {why}", frame.name));
        self.folder.note_failure(frame, &why)?;
        failed.push((frame.name.clone(), why));
        Ok(())
    }

    /// Computes one frame from its images and what the previous frame left: just now (`state`), or on disk.
    fn compute(
        &self,
        i: usize,
        state: Option<FrameState>,
        frame: Result<ReadFrame>,
        quiet: &Progress,
    ) -> Result<ComputedFrame> {
        let output = self.folder.start(&self.frames[i])?;
        let ReadFrame { capture, neighbors, inputs, truth } = frame?;
        check_mono(&capture, self.set, &self.frames[i], &self.field)?;
        let state = match i.checked_sub(1) {
            Some(_) if state.is_some() && !self.plan.is_key(i) => state,
            Some(previous) if !self.plan.is_key(i) => self.folder.state(&self.frames[previous])?,
            _ => None,
        };
        let input = FrameInput {
            state: state.as_ref(),
            neighbors: &neighbors,
            rig: self.rig,
            field: &self.field,
            options: &self.args.options,
            motion: &self.args.motion,
        };
        let result = reconstruct_frame(&input, capture, ReconstructionContext::new(quiet, self.args.options.device)?)?;
        let judgment = &result.diagnostics.reconstruction.judgment;
        if verdict::refused(judgment, self.args.accept) {
            anyhow::bail!("{}", verdict::refusal(judgment, "the frame"));
        }
        Ok(ComputedFrame { frame: i, result, truth, inputs, output })
    }

    /// Evaluates a frame and puts its result into place.
    fn write(&self, computed: ComputedFrame) -> Result<()> {
        let ComputedFrame { frame, result, truth, inputs, output } = computed;
        let (camera, shot, surface) = (&self.rig.camera, &self.frames[frame], &result.surface);
        let metrics = truth.as_ref().map(|truth| {
            let maps =
                EvaluatedMaps { depth: &surface.depth, normals: Some(&surface.normals), sigma: Some(&surface.sigma) };
            evaluate(&maps, truth, &truth.regions(camera), camera, self.rig.projector.as_ref())
        });
        let metadata = ResultMetadata {
            rig: self.rig.root.clone(),
            rig_name: self.rig.name.clone(),
            scene: shot.name.clone(),
            set: self.set.name.clone(),
            inputs: self.inputs.iter().cloned().chain(inputs).collect(),
            judgment: result.diagnostics.reconstruction.judgment.clone(),
            ..ResultMetadata::default()
        }
        .with_evaluation(metrics.as_ref(), None::<&()>);
        let summary = Summary::new(surface, &result.diagnostics, &result.stages, camera, &metadata);
        result::write_into(output.path(), surface, &summary, ExtraFiles::default())?;
        output.commit()?;
        self.folder.forget_failure(shot)
    }
}

/// Returns the next frame that was read, which is number `i`.
fn receive(i: usize, read: &Receiver<(usize, Result<ReadFrame>)>) -> Result<Result<ReadFrame>> {
    // Without an answer the reader was stopped.
    let (number, frame) = read.recv().context("stopped")?;
    assert_eq!(number, i, "frames are read in their order");
    Ok(frame)
}

/// Returns what a thread returned; panics as the thread did.
fn joined<T>(thread: ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
