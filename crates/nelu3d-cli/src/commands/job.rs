//! What every command that makes a result folder shares: run a method, judge, write, report.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use nelu3d::reconstruct::{Observer, reconstruct_observed};
use nelu3d::result::{self, Input, MeshFiles, ResultMetadata, Summary};
use nelu3d::{Reconstruction, ReconstructionOptions, Surface};
use nelu3d_baselines::{DecodeOptions, Decoding, decode};
use nelu3d_evaluate::{EvaluatedMaps, GroundTruth, Metrics, Trace, evaluate};
use nelu3d_scan::Rig;
use nelu3d_scan::output::{OutputDir, write_atomic};
use nelu3d_scan::rig::{Need, PatternSet, Shot};

use super::{Context, load_field, shown};
use crate::args::MeshFormat;
use crate::report::Page;

/// The method that makes the result, with what it alone needs.
pub(crate) enum Work {
    /// From a color field.
    Reconstruct {
        /// The color field to use.
        field: PathBuf,
        /// Settings of the method.
        options: ReconstructionOptions,
        /// Whether to record the error after every iteration.
        trace: bool,
    },
    /// With a decoder, from a calibrated projector.
    Decode(DecodeOptions),
}

/// One result, with everything decided.
pub(crate) struct Job<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// The scene.
    pub shot: Shot,
    /// The pattern set.
    pub set: &'a PatternSet,
    /// The result folder.
    pub output: PathBuf,
    /// What to judge the result against.
    pub truth: Option<PathBuf>,
    /// Mesh files to write besides mesh.ply.
    pub mesh_files: MeshFiles,
    /// The method.
    pub work: Work,
}

/// What a method made.
enum Made {
    Reconstruction(Reconstruction),
    Decoding(Decoding),
}

impl Made {
    fn surface(&self) -> &Surface {
        match self {
            Made::Reconstruction(r) => &r.surface,
            Made::Decoding(d) => &d.surface,
        }
    }

    fn summary(&self, rig: &Rig, about: &ResultMetadata) -> Summary {
        match self {
            Made::Reconstruction(r) => Summary::new(&r.surface, &r.diagnostics, &r.stages, &rig.camera, about),
            Made::Decoding(d) => Summary::new(&d.surface, &d.diagnostics, &d.stages, &rig.camera, about),
        }
    }
}

/// A result that was written.
pub(crate) struct Written {
    /// What its result.json says.
    pub summary: Summary,
    /// Its errors, if there is a ground truth.
    pub metrics: Option<Metrics>,
}

impl Job<'_> {
    /// Runs the method and writes the result folder.
    pub(crate) fn run(&self, context: &Context) -> Result<Written> {
        // Begun first: hours of work must not end at a folder that cannot be written.
        let folder = OutputDir::create(&self.output, "result.json")?;
        // Nor at a ground truth that cannot be read; the reconstruction never sees it.
        let truth = self.truth.as_deref().map(|dir| GroundTruth::read(dir, &self.rig.camera)).transpose()?;
        let mut trace = None;
        let made = match &self.work {
            Work::Reconstruct { field, options, trace: wanted } => {
                trace = truth.as_ref().filter(|_| *wanted).map(|t| Trace::new(t, &self.rig.camera));
                let observer = trace.as_mut().map(|t| t as &mut dyn Observer);
                let field = load_field(self.rig, self.set, field)?;
                let (rig, set, progress) = (self.rig, self.set, &context.progress);
                Made::Reconstruction(reconstruct_observed(rig, set, &self.shot, &field, options, progress, observer)?)
            }
            Work::Decode(options) => {
                Made::Decoding(decode(self.rig, self.set, &self.shot, options, &context.progress)?)
            }
        };
        context.stop_if_asked()?;

        context.progress.stage("write the result");
        let surface = made.surface();
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
            ..ResultMetadata::default()
        }
        .with_evaluation(metrics.as_ref(), trace.as_ref());
        let summary = made.summary(self.rig, &about);
        result::write_into(folder.path(), surface, &summary, self.mesh_files)?;
        let (captures, black) = self.captures()?;
        let page = Page {
            surface,
            summary: &summary,
            metrics: metrics.as_ref(),
            trace: trace.as_deref(),
            captures: &captures,
            black: black.as_ref(),
            truth: truth.as_ref(),
        };
        let report = folder.path().join("report.html");
        write_atomic(&report, |w| w.write_all(page.html().as_bytes()))?;
        context.stop_if_asked()?;
        folder.commit()?;
        Ok(Written { summary, metrics })
    }

    /// The files that were read, hashed.
    fn inputs(&self) -> Result<Vec<Input>> {
        let rig = self.rig;
        let black = self.shot.dir.join(&rig.black);
        let mut paths = vec![rig.root.join(nelu3d_scan::rig::RIG_FILE), rig.root.join(&rig.camera_file)];
        match &self.work {
            Work::Reconstruct { field, .. } => paths.push(field.clone()),
            Work::Decode(options) if !options.method.needs_projector() => {
                paths.extend(options.lookup3d.table.clone());
            }
            Work::Decode(_) => {
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
        paths.iter().map(|p| hash(p)).collect()
    }

    /// What the report shows of the scene: white and the patterns; and black, where there is one.
    #[expect(clippy::type_complexity, reason = "named images, and one more")]
    fn captures(&self) -> Result<(Vec<(String, nelu3d_scan::Image)>, Option<nelu3d_scan::Image>)> {
        let capture = self.rig.read_shot(&self.shot, self.set, Need::Scene)?;
        let mut all = vec![(self.rig.white.clone(), capture.white)];
        all.extend(self.set.images.iter().cloned().zip(capture.patterns));
        Ok((all, capture.black))
    }
}

fn hash(path: &Path) -> Result<Input> {
    Input::of(path).with_context(|| format!("{}: cannot be read", shown(path)))
}

/// The mesh files that were asked for.
pub(crate) fn mesh_files(formats: &[MeshFormat]) -> MeshFiles {
    let has = |format| formats.contains(&format);
    MeshFiles { obj: has(MeshFormat::Obj), stl: has(MeshFormat::Stl), glb: has(MeshFormat::Glb) }
}

/// Runs a job and prints its answer.
pub(crate) fn answer(job: &Job<'_>, context: &Context) -> Result<()> {
    let Written { summary, metrics } = job.run(context)?;
    context.answer(&serde_json::json!({ "result": job.output, "summary": summary }), || {
        let metrics = metrics.as_ref().map(|m| format!("\n{m}")).unwrap_or_default();
        format!(
            "{} of {} pixels have a depth\n{metrics}result  {}\nreport  {}",
            summary.pixels.valid,
            summary.pixels.total,
            shown(&job.output),
            shown(&job.output.join("report.html"))
        )
    })
}
