//! What every command that makes a result folder shares: run a method, evaluate, write, report.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use nelu3d::reconstruct::{Observer, reconstruct_observed};
use nelu3d::result::{self, ExtraFiles, Input, ResultMetadata, Summary};
use nelu3d::sensor::judge_capture;
use nelu3d::verdict::Judgment;
use nelu3d::{Reconstruction, ReconstructionOptions, Surface};
use nelu3d_baselines::{DecodeOptions, Decoding, decode};
use nelu3d_evaluate::{EvaluatedMaps, GroundTruth, Metrics, Trace, evaluate};
use nelu3d_scan::Rig;
use nelu3d_scan::output::{OutputDir, write_atomic};
use nelu3d_scan::rig::{Need, PatternSet, Shot};
use rayon::prelude::*;

use crate::args::{MeshFormat, OtherFormat};
use crate::context::CommandContext;
use crate::paths::{load_field, shown};
use crate::verdict;
use nelu3d_report::{Captures, ResultReport};

/// The method that makes a result, with what only that method needs.
pub(super) enum ResultMethod {
    /// Reconstruction from a color field.
    Reconstruct {
        /// The color field to use.
        field: PathBuf,
        /// Settings of the method.
        options: ReconstructionOptions,
        /// Whether to record the error after every iteration.
        trace: bool,
        /// Whether the field is corrected for what moved since the sweep.
        correct: bool,
    },
    /// One of the baselines.
    Decode(DecodeOptions),
}

/// One result that is to be made, with everything decided.
pub(super) struct ResultJob<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// The scene.
    pub shot: Shot,
    /// The pattern set.
    pub set: &'a PatternSet,
    /// The result folder.
    pub output: PathBuf,
    /// Folder of the ground truth that the result is evaluated against.
    pub ground_truth: Option<PathBuf>,
    /// Files to write besides those of every result.
    pub extra: ExtraFiles,
    /// Whether a bad result is written all the same.
    pub accept: bool,
    /// The method.
    pub method: ResultMethod,
}

/// What a method returned.
enum MethodOutput {
    Reconstruction(Reconstruction),
    Decoding(Decoding),
}

impl MethodOutput {
    /// Returns the surface.
    fn surface(&self) -> &Surface {
        match self {
            MethodOutput::Reconstruction(r) => &r.surface,
            MethodOutput::Decoding(d) => &d.surface,
        }
    }

    /// Returns whether to trust the surface. What a baseline decoded is judged by its captures alone.
    fn judgment(&self, job: &ResultJob<'_>) -> Result<Judgment> {
        Ok(match self {
            MethodOutput::Reconstruction(r) => r.diagnostics.judgment.clone(),
            MethodOutput::Decoding(d) => {
                let capture = job.rig.read_shot(&job.shot, job.set, Need::Scene)?;
                let mut judgment = Judgment::default();
                judgment.extend(judge_capture(&capture, &d.surface.status, &job.set.images));
                judgment
            }
        })
    }

    /// Returns the content of result.json.
    fn summary(&self, rig: &Rig, about: &ResultMetadata) -> Summary {
        match self {
            MethodOutput::Reconstruction(r) => Summary::new(&r.surface, &r.diagnostics, &r.stages, &rig.camera, about),
            MethodOutput::Decoding(d) => Summary::new(&d.surface, &d.diagnostics, &d.stages, &rig.camera, about),
        }
    }
}

/// A result that was made.
pub(super) struct WrittenResult {
    /// Content of its result.json.
    pub summary: Summary,
    /// Errors of the result against the ground truth, if it was evaluated.
    pub metrics: Option<Metrics>,
    /// Whether it was written: not if it is bad, unless that is accepted.
    pub written: bool,
}

impl ResultJob<'_> {
    /// Runs the method and writes the result folder, unless the result is bad.
    pub(super) fn run(&self, context: &CommandContext) -> Result<WrittenResult> {
        // Begun first: hours of work must not end at a folder that cannot be written.
        let folder = OutputDir::create(&self.output, "result.json")?;
        // Nor at a ground truth that cannot be read; the reconstruction never sees it.
        let truth = self.ground_truth.as_deref().map(|dir| GroundTruth::read(dir, &self.rig.camera)).transpose()?;
        let mut trace = None;
        let made = match &self.method {
            ResultMethod::Reconstruct { field, options, trace: wanted, correct } => {
                trace = truth.as_ref().filter(|_| *wanted).map(|t| Trace::new(t, &self.rig.camera));
                let observer = trace.as_mut().map(|t| t as &mut dyn Observer);
                let mut field = load_field(self.rig, self.set, field)?;
                if *correct {
                    field = super::check::corrected_field(self.rig, self.set, &self.shot, field, context)?;
                }
                let (rig, set, progress) = (self.rig, self.set, &context.progress);
                MethodOutput::Reconstruction(reconstruct_observed(
                    rig, set, &self.shot, &field, options, progress, observer,
                )?)
            }
            ResultMethod::Decode(options) => {
                MethodOutput::Decoding(decode(self.rig, self.set, &self.shot, options, &context.progress)?)
            }
        };
        context.stop_if_asked()?;

        context.progress.stage("write the result");
        let surface = made.surface();
        let judgment = made.judgment(self)?;
        verdict::show(&judgment, context);
        let refused = verdict::refused(&judgment, self.accept);
        let metrics = truth.as_ref().map(|truth| {
            let maps =
                EvaluatedMaps { depth: &surface.depth, normals: Some(&surface.normals), sigma: Some(&surface.sigma) };
            let regions = truth.regions(&self.rig.camera);
            evaluate(&maps, truth, &regions, &self.rig.camera, self.rig.projector.as_ref())
        });
        let trace = trace.map(Trace::points);
        let about = ResultMetadata {
            rig: self.rig.root.clone(),
            rig_name: self.rig.name.clone(),
            scene: self.shot.name.clone(),
            set: self.set.name.clone(),
            inputs: self.inputs()?,
            judgment,
            ..ResultMetadata::default()
        }
        .with_evaluation(metrics.as_ref(), trace.as_ref());
        let summary = made.summary(self.rig, &about);
        if refused {
            return Ok(WrittenResult { summary, metrics, written: false });
        }
        let page = || -> Result<()> {
            let captures = Captures::read(self.rig, self.set, &self.shot)?;
            let page = ResultReport {
                surface,
                summary: &summary,
                metrics: metrics.as_ref(),
                trace: trace.as_deref(),
                captures: &captures,
                truth: truth.as_ref(),
            };
            let report = folder.path().join("report.html");
            Ok(write_atomic(&report, |w| w.write_all(page.html().as_bytes()))?)
        };
        let (written, page) = rayon::join(|| result::write_into(folder.path(), surface, &summary, self.extra), page);
        written?;
        page?;
        context.stop_if_asked()?;
        folder.commit()?;
        Ok(WrittenResult { summary, metrics, written: true })
    }

    /// Hashes the files that were read.
    fn inputs(&self) -> Result<Vec<Input>> {
        let rig = self.rig;
        let black = self.shot.dir.join(&rig.black);
        let mut paths = vec![rig.root.join(nelu3d_scan::rig::RIG_FILE), rig.root.join(&rig.camera_file)];
        match &self.method {
            ResultMethod::Reconstruct { field, .. } => paths.push(field.clone()),
            ResultMethod::Decode(options) if !options.method.needs_projector() => {
                paths.extend(options.lookup3d.table.clone());
            }
            ResultMethod::Decode(_) => {
                paths.push(rig.root.join(nelu3d_scan::rig::PROJECTOR_FILE));
                paths.extend(self.set.images.iter().map(|name| rig.projected(name)));
                paths.extend(self.set.inverse.iter().map(|name| self.shot.dir.join(name)));
            }
        }
        // Not every method needs every file.
        paths.retain(|p| p.exists());
        paths.push(self.shot.dir.join(&rig.white));
        paths.extend(black.exists().then_some(black));
        paths.extend(self.set.images.iter().map(|name| self.shot.dir.join(name)));
        paths.par_iter().map(|p| hash(p)).collect()
    }
}

/// Hashes a file.
fn hash(path: &Path) -> Result<Input> {
    Input::of(path).with_context(|| format!("{}: cannot be read", shown(path)))
}

/// Returns the files that were asked for.
pub(super) fn extra_files(meshes: &[MeshFormat], others: &[OtherFormat]) -> ExtraFiles {
    let mut extra = ExtraFiles::default();
    for mesh in meshes {
        *mesh.file_in(&mut extra) = true;
    }
    for other in others {
        *other.file_in(&mut extra) = true;
    }
    extra
}

/// Runs a job and prints its answer. A bad result that was not written is an error.
pub(super) fn answer(job: &ResultJob<'_>, context: &CommandContext) -> Result<()> {
    let WrittenResult { summary, metrics, written } = job.run(context)?;
    let judgment = &summary.judgment;
    let json = serde_json::json!({
        "verdict": judgment.verdict,
        "warnings": judgment.warnings,
        "notes": judgment.notes,
        "result": written.then(|| shown(&job.output)),
        "summary": summary,
    });
    context.answer(&json, || {
        let metrics = metrics.as_ref().map(|m| format!("\n{m}")).unwrap_or_default();
        let depth = &summary.depth_mm;
        let mut text = verdict::first_line(judgment);
        text += &format!("{} of {} pixels have a depth", summary.pixels.valid, summary.pixels.total);
        text += &format!(", from {:.1} to {:.1} mm (median {:.1})\n{metrics}", depth.min, depth.max, depth.median);
        for note in &judgment.notes {
            text += &format!("note    {note}\n");
        }
        if written {
            let report = job.output.join("report.html");
            text += &format!("result  {}\nreport  {}", shown(&job.output), shown(&report));
        }
        text
    })?;
    if !written {
        bail!("{}", verdict::refusal(judgment, &shown(&job.output)));
    }
    Ok(())
}
