//! `nelu3d sequence`: a folder of frames becomes a moving surface.
//!
//! Every frame is a result folder that appears whole or not at all, so the folder itself says how far the work is: after a kill, a
//! crash or a power cut the same command goes on where it stopped, and several machines can work on parts of one sequence
//! in one shared folder without talking to each other.

mod ahead;
mod folder;
mod outputs;
mod slurm;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;
use std::sync::mpsc::Receiver;
use std::thread::ScopedJoinHandle;

use anyhow::{Context as _, Result};
use nelu3d::color_field::ColorField;
use nelu3d::color_field::check_mono;
use nelu3d::reconstruct::Context as ReconstructionContext;
use nelu3d::result::{self, Input, MeshFiles, ResultMetadata, Summary};
use nelu3d::sequence::{FrameInput, FrameReconstruction, FrameState, Plan, reconstruct_frame};
use nelu3d_evaluate::{EvaluatedMaps, GroundTruth, evaluate};
use nelu3d_field::device::Device;
use nelu3d_scan::Rig;
use nelu3d_scan::output::OutputDir;
use nelu3d_scan::rig::{PatternSet, Shot};

use self::ahead::{Ahead, ReadFrame};
use self::folder::Folder;
use super::{Context, default_field, default_result, load_field, shown};
use crate::args;

/// Everything that stays the same from frame to frame.
struct Work<'a> {
    rig: &'a Rig,
    set: &'a PatternSet,
    frames: Vec<Shot>,
    field: ColorField,
    /// Files that all frames are made from, hashed.
    inputs: Vec<Input>,
    args: &'a args::Sequence,
    plan: Plan,
    folder: Folder,
}

/// Runs the command.
pub(crate) fn run(args: &args::Sequence, context: &Context) -> Result<ExitCode> {
    let rig = Rig::open(&args.rig)?;
    let set = rig.pattern_set(args.set.as_deref())?;
    let frames = rig.sequence(&args.sequence)?;
    let output = match &args.output {
        Some(output) => output.clone(),
        None => {
            let dir = frames[0].dir.canonicalize().with_context(|| format!("{}: is gone", shown(&frames[0].dir)))?;
            let name = dir.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
            default_result(&rig, &name, &set.name)
        }
    };
    let path = args.field.clone().unwrap_or_else(|| default_field(&rig, &set.name));
    if let Some(script) = &args.slurm {
        return slurm::write(script, args, &output, frames.len(), context);
    }
    context.open_device(args.options.device)?;
    let field = load_field(&rig, set, &path)?;
    let mut inputs = Vec::new();
    for file in [rig.root.join(nelu3d_scan::rig::RIG_FILE), rig.root.join(&rig.camera_file), path] {
        inputs.push(Input::of(&file).with_context(|| format!("{}: cannot be read", shown(&file)))?);
    }
    let plan = Plan { frames: frames.len(), keyframe: args.keyframe.get() };
    let settings = serde_json::json!({
        "field": inputs[2].sha256,
        "set": set.name,
        "keyframe": args.keyframe,
        "options": args.options,
        "motion": args.motion,
    });
    let folder = Folder::open(&output, &settings)?;
    let work = Work { rig: &rig, set, frames, field, inputs, args, plan, folder };
    let failed = work.all(context)?;

    let done = work.frames.iter().filter(|f| work.folder.is_done(f)).count();
    let complete = work.frames.iter().all(|f| work.folder.is_done(f) || work.folder.failure(f).is_some());
    let mut answer = serde_json::json!({
        "sequence": output, "frames": work.frames.len(), "done": done, "failed": failed, "complete": complete,
    });
    let mut text = format!("{done} of {} frames are done\n", work.frames.len());
    if complete && done > 0 {
        context.progress.stage("write the moving surface");
        let table = outputs::write(&work.folder, &work.frames, args.fps)?;
        answer["table"] = table.json();
        answer["mean"] = table.mean();
        text += &format!("\n{table}");
        text += &format!("animation  {}\n", shown(&output.join(outputs::ANIMATION)));
        text += &format!("preview    {}\n", shown(&output.join(outputs::PREVIEW)));
        text += &format!("meshes     {}\n", shown(&output.join(outputs::MESHES)));
    }
    text += &format!("sequence   {}", shown(&output));
    context.answer(&answer, || text)?;
    if !failed.is_empty() {
        let listed: Vec<String> = failed.iter().map(|(frame, why)| format!("{frame}: {why}")).collect();
        anyhow::bail!("{} of {} frames failed: {}", failed.len(), work.frames.len(), listed.join("; "));
    }
    Ok(ExitCode::SUCCESS)
}

/// A frame that is computed and not yet on disk.
struct Computed {
    frame: usize,
    result: FrameReconstruction,
    truth: Option<GroundTruth>,
    /// The files of its capture, hashed.
    inputs: Vec<Input>,
    output: OutputDir,
}

impl Work<'_> {
    /// Computes the frames of this part that are not there yet. Returns those that failed, and why.
    ///
    /// While a frame is computed, the next one is read and the one before is written.
    fn all(&self, context: &Context) -> Result<Vec<(String, String)>> {
        let part = self.args.shard.map_or(0..self.plan.frames, |s| self.plan.part(s));
        let quiet = context.silent();
        let on_device = !Device::or_cpu(self.args.options.device).is_cpu();
        let mut failed = Vec::new();
        let todo: Vec<usize> = part.filter(|i| !self.folder.is_done(&self.frames[*i])).collect();
        if todo.len() < self.plan.frames {
            context.progress.stage(&format!("{} of {} frames to do", todo.len(), self.plan.frames));
        }
        let ahead = Ahead {
            rig: self.rig,
            set: self.set,
            frames: &self.frames,
            plan: self.plan,
            motion: self.args.motion.motion,
            with_truth: self.args.truth,
            flashes: BTreeMap::new(),
        };
        std::thread::scope(|scope| {
            // Nothing is kept on the way: a frame is handed over, or the reader waits with it.
            let (to, read) = std::sync::mpsc::sync_channel(0);
            let (numbers, progress) = (&todo, &quiet);
            scope.spawn(move || ahead.run(numbers, &to, progress));
            let mut writing: Option<(usize, ScopedJoinHandle<'_, Result<()>>)> = None;
            let mut before = None;
            let mut early: Option<ScopedJoinHandle<'_, Result<Computed>>> = None;
            for (done, &i) in todo.iter().enumerate() {
                context.stop_if_asked()?;
                context.progress.stage(&format!("frame {}", self.frames[i].name));
                context.progress.tick(done, todo.len());
                let state = before.take().filter(|(frame, _)| frame + 1 == i).map(|(_, state)| state);
                let begun = early.take();
                let own = if begun.is_none() { Some(receive(i, &read)?) } else { None };
                // A keyframe needs nothing of the frame before it: its cost volume is on the device while that one is refined here.
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
        context: &Context,
    ) -> Result<()> {
        let Err(e) = outcome else { return Ok(()) };
        // Ctrl-C is not the frame's fault; a full disk is, but also that of every other frame.
        context.stop_if_asked()?;
        let (frame, why) = (&self.frames[frame], format!("{e:#}"));
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
        quiet: &nelu3d::Progress,
    ) -> Result<Computed> {
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
            camera: &self.rig.camera,
            field: &self.field,
            options: &self.args.options,
            motion: &self.args.motion,
        };
        let result = reconstruct_frame(&input, capture, ReconstructionContext::new(quiet, self.args.options.device)?)?;
        Ok(Computed { frame: i, result, truth, inputs, output })
    }

    /// Judges a frame and puts its result into place.
    fn write(&self, computed: Computed) -> Result<()> {
        let Computed { frame, result, truth, inputs, output } = computed;
        let (camera, shot, surface) = (&self.rig.camera, &self.frames[frame], &result.surface);
        let metrics = truth.as_ref().map(|truth| {
            let maps =
                EvaluatedMaps { depth: &surface.depth, normals: Some(&surface.normals), sigma: Some(&surface.sigma) };
            evaluate(&maps, truth, &truth.regions(camera), camera, self.rig.projector.as_ref())
        });
        let about = ResultMetadata {
            rig: self.rig.root.clone(),
            rig_name: self.rig.name.clone(),
            scene: shot.name.clone(),
            set: self.set.name.clone(),
            inputs: self.inputs.iter().cloned().chain(inputs).collect(),
            ..ResultMetadata::default()
        }
        .with_evaluation(metrics.as_ref(), None::<&()>);
        let summary = Summary::new(surface, &result.diagnostics, &result.stages, camera, &about);
        result::write_into(output.path(), surface, &summary, MeshFiles::default())?;
        output.commit()?;
        self.folder.forget_failure(shot)
    }
}

/// The next frame that was read, which is number `i`.
fn receive(i: usize, read: &Receiver<(usize, Result<ReadFrame>)>) -> Result<Result<ReadFrame>> {
    // Without an answer the reader was stopped.
    let (number, frame) = read.recv().context("stopped")?;
    assert_eq!(number, i, "frames are read in their order");
    Ok(frame)
}

/// What a thread returned; it panics as the thread did.
fn joined<T>(thread: ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
