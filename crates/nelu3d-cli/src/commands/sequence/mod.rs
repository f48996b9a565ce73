//! `nelu3d sequence`: a folder of frames becomes a moving surface.
//!
//! Every frame is a result folder that appears whole or not at all, so the folder itself says how far the work is: after a kill, a
//! crash or a power cut the same command goes on where it stopped, and several machines can work on parts of one sequence
//! in one shared folder without talking to each other.

mod folder;
mod outputs;
mod slurm;

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use nelu3d::color_field::ColorField;
use nelu3d::evaluate::{Judged, Truth, evaluate};
use nelu3d::result::{self, About, Input, MeshFiles, StageClock, Summary};
use nelu3d::sequence::{self, MotionMode, Neighbors, Plan};
use nelu3d_scan::rig::{Need, PatternSet, Shot};
use nelu3d_scan::{Image, Rig};

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

impl Work<'_> {
    /// Computes the frames of this part that are not there yet. Returns those that failed, and why.
    fn all(&self, context: &Context) -> Result<Vec<(String, String)>> {
        let part = self.args.shard.map_or(0..self.plan.frames, |s| self.plan.part(s));
        let quiet = context.silent();
        let mut failed = Vec::new();
        let todo: Vec<usize> = part.filter(|i| !self.folder.is_done(&self.frames[*i])).collect();
        if todo.len() < self.plan.frames {
            context.progress.stage(&format!("{} of {} frames to do", todo.len(), self.plan.frames));
        }
        for (done, i) in todo.iter().enumerate() {
            context.stop_if_asked()?;
            let frame = &self.frames[*i];
            context.progress.stage(&format!("frame {}", frame.name));
            context.progress.tick(done, todo.len());
            match self.one(*i, &quiet) {
                Ok(()) => self.folder.forget_failure(frame)?,
                Err(e) => {
                    // Ctrl-C is not the frame's fault; a full disk is, but also that of every other frame.
                    context.stop_if_asked()?;
                    let why = format!("{e:#}");
                    context.progress.warn(format!("frame {}: {why}", frame.name));
                    self.folder.note_failure(frame, &why)?;
                    failed.push((frame.name.clone(), why));
                }
            }
        }
        Ok(failed)
    }

    /// One frame, from its images and what is on disk of the frame before: whether that was just computed or lay there.
    fn one(&self, i: usize, quiet: &nelu3d::Progress) -> Result<()> {
        let shot = &self.frames[i];
        let output = self.folder.start(shot)?;
        let truth = self.args.truth.then(|| Truth::read(&shot.dir.join("truth"), &self.rig.camera)).transpose()?;
        let memory = match i.checked_sub(1) {
            Some(before) if !self.plan.is_key(i) => self.folder.memory(&self.frames[before])?,
            _ => None,
        };
        let mut clock = StageClock::new(quiet);
        clock.begin("read the frame");
        let capture = self.rig.read_shot(shot, self.set, Need::Frame)?;
        let neighbors = match self.args.motion.motion {
            MotionMode::Off => Neighbors::default(),
            _ => Neighbors {
                before: i.checked_sub(1).and_then(|j| self.flash(j)),
                after: (i + 1 < self.frames.len()).then(|| self.flash(i + 1)).flatten(),
            },
        };
        let (camera, args) = (&self.rig.camera, self.args);
        let mut result = sequence::frame(
            memory.as_ref(),
            capture,
            &neighbors,
            camera,
            &self.field,
            &args.options,
            &args.motion,
            quiet,
            &mut clock,
        )
        .map_err(|e| anyhow::anyhow!("{e}"))?;
        result.stages = clock.finish();
        let metrics = truth.as_ref().map(|truth| {
            let judged = Judged { depth: &result.depth, normals: Some(&result.normals), sigma: Some(&result.sigma) };
            evaluate(&judged, truth, &truth.regions(camera), camera, self.rig.projector.as_ref())
        });
        let mut inputs = self.inputs.clone();
        for name in std::iter::once(&self.rig.white).chain(&self.set.images) {
            let path = shot.dir.join(name);
            inputs.push(Input::of(&path).with_context(|| format!("{}: cannot be read", shown(&path)))?);
        }
        let about = About {
            rig: self.rig.root.clone(),
            rig_name: self.rig.name.clone(),
            scene: shot.name.clone(),
            set: self.set.name.clone(),
            inputs,
            metrics,
            trace: None,
        };
        let summary = Summary::new(&result, camera, &about);
        result::write_into(output.path(), &result, &summary, MeshFiles::default())?;
        Ok(output.commit()?)
    }

    /// The flash of a neighboring frame; a neighbor that cannot be read is none, and fails by itself when its turn comes.
    fn flash(&self, i: usize) -> Option<Image> {
        self.rig.read_image(&self.frames[i].dir.join(&self.rig.white)).ok()
    }
}
