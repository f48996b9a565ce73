//! Recipe `fast` on a virtual rig that is made for it: calibration, a scene stage by stage against the machine's
//! ceilings, and a frame of a sequence from the one before it.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context as _, Result};
use nelu3d::progress::StageTime;
use nelu3d::reconstruct::{self, reconstruct};
use nelu3d::sequence::{FrameInput, FrameState, MotionOptions, Neighbors, reconstruct_frame};
use nelu3d::{CalibrationOptions, ReconstructionOptions, Sink, calibrate};
use nelu3d_field::bench::{Demand, Machine};
use nelu3d_field::device::Choice;
use nelu3d_scan::Rig;
use nelu3d_scan::rig::Need;
use nelu3d_sim::Spec;
use nelu3d_sim::spec::{MotionSpec, MovingObjectSpec, SequenceSpec, SweepSpec};
use serde::Serialize;

use crate::context::CommandContext;

/// What the section is called on the command line.
pub(super) const NAME: &str = "fast";

/// Preset of the virtual scanner: 640 × 480 pixels, three patterns.
const PRESET: &str = "dlp";
/// Positions of its sweep: enough for a field, fewer than the preset's for time.
const POSITIONS: usize = 16;
/// The scene, and the sequence of the same object.
const SCENE: &str = "vase";
/// Frames: the first from its scene alone, the others from the one before.
const FRAMES: usize = 3;

/// A stage of the reconstruction, or a part of one.
#[derive(Clone, Debug, Serialize)]
pub(super) struct PartResult {
    /// Name of the stage, or of the part of one, as `Progress::measure` reports it.
    name: String,
    /// Processor time of all threads, s.
    cpu_secs: f64,
    /// Floating-point operations.
    flops: f64,
    /// Bytes from and to main memory in order.
    bytes: f64,
    /// Which resource limits it.
    bound: String,
    /// The least possible time over the time taken, 0..1.
    share_of_ceiling: f64,
}

/// Recipe `fast`, measured.
#[derive(Clone, Debug, Serialize)]
pub(super) struct FastReport {
    /// The virtual scanner's preset.
    rig: String,
    /// Pixels of the surface.
    pixels: usize,
    /// Stages of a calibration.
    calibration: Vec<StageTime>,
    /// The reconstruction of a scene.
    scene: WorkResult,
    /// Processor time of every frame of a sequence, s: the first one begins anew, the others do not.
    frames_cpu_secs: Vec<f64>,
    /// The last of these frames.
    frame: WorkResult,
}

/// A reconstruction, measured.
#[derive(Clone, Debug, Serialize)]
pub(super) struct WorkResult {
    /// Stages of the reconstruction: elapsed and processor time of each, s.
    stages: Vec<StageTime>,
    /// Parts of the stages whose operations and bytes are counted.
    parts: Vec<PartResult>,
}

impl WorkResult {
    /// Puts the parts that were `heard` so far beside the least time that they take on a machine.
    fn new(stages: Vec<StageTime>, heard: &Parts, machine: &Machine) -> Self {
        let part = |(name, cpu_secs, demand): (String, f64, Demand)| {
            let (bound, least) = demand.floor(machine);
            let share_of_ceiling = if cpu_secs > 0.0 { least / cpu_secs } else { 0.0 };
            PartResult {
                name,
                cpu_secs,
                flops: demand.flops,
                bytes: demand.bytes,
                bound: bound.into(),
                share_of_ceiling,
            }
        };
        Self { stages, parts: heard.take().into_iter().map(part).collect() }
    }

    /// Writes the stages in one line, and the parts as a table.
    fn write(&self, f: &mut fmt::Formatter, what: &str) -> fmt::Result {
        write_stages(f, what, &self.stages)?;
        writeln!(f, "  {:16} {:>8} {:>8} {:>8}  {:12} {:>7}", "", "CPU s", "GFLOP", "GB", "limit", "reached")?;
        for p in &self.parts {
            writeln!(
                f,
                "  {:16} {:8.3} {:8.2} {:8.2}  {:12} {:6.0}%",
                p.name,
                p.cpu_secs,
                p.flops * 1e-9,
                p.bytes * 1e-9,
                p.bound,
                100.0 * p.share_of_ceiling
            )?;
        }
        Ok(())
    }
}

/// A sink that adds up the parts of the work.
#[derive(Default)]
struct Parts(Mutex<Vec<(String, f64, Demand)>>);

impl Parts {
    /// Returns the parts so far, and begins anew.
    fn take(&self) -> Vec<(String, f64, Demand)> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Sink for Parts {
    fn stage(&self, _: &str) {}
    fn tick(&self, _: usize, _: usize) {}
    fn warn(&self, message: &str) {
        tracing::warn!("{message}");
    }
    fn worked(&self, part: &str, cpu_secs: f64, demand: &Demand) {
        let mut parts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = parts.iter().position(|p| p.0 == part);
        let at = found.unwrap_or_else(|| {
            parts.push((part.to_owned(), 0.0, Demand::default()));
            parts.len() - 1
        });
        let (_, secs, sum) = &mut parts[at];
        *secs += cpu_secs;
        sum.flops += demand.flops;
        sum.bytes += demand.bytes;
    }
}

/// Makes the rig, and measures everything on it once.
pub(super) fn measure(machine: &Machine, context: &CommandContext) -> Result<FastReport> {
    let dir = tempfile::tempdir().context("a folder for the virtual rig cannot be made")?;
    let root = dir.path().join("rig");
    crate::commands::simulate::write(&spec()?, &root, context)?;
    let rig = Rig::open(&root)?;
    let set = rig.pattern_set(None)?;
    context.progress.stage("Calibrating");
    let quiet = context.silent();
    let (field, report) = calibrate(&rig, set, &CalibrationOptions::default(), &quiet)?;

    context.progress.stage("Reconstructing");
    let options = ReconstructionOptions { device: Choice::Cpu, ..Default::default() };
    let heard = Arc::new(Parts::default());
    let progress = context.heard_by(heard.clone());
    let scene = reconstruct(&rig, set, &rig.scene(SCENE)?, &field, &options, &progress)?;
    let pixels = scene.surface.depth.iter().filter(|z| z.is_finite()).count();
    let scene = WorkResult::new(scene.stages, &heard, machine);
    let mut frames = Vec::new();
    let shots = rig.sequence(SCENE)?;
    let captures = shots.iter().map(|shot| rig.read_shot(shot, set, Need::Scene)).collect::<Result<Vec<_>, _>>()?;
    let mut state: Option<FrameState> = None;
    for (i, capture) in captures.iter().enumerate() {
        let before = i.checked_sub(1).map(|i| captures[i].white.clone());
        let neighbors = Neighbors::new(before, captures.get(i + 1).map(|c| c.white.clone()));
        let (options, motion) = (&options, &MotionOptions::default());
        let input =
            FrameInput { state: state.as_ref(), neighbors: &neighbors, rig: &rig, field: &field, options, motion };
        let cx = reconstruct::Context::new(&progress, options.device)?;
        let frame = reconstruct_frame(&input, capture.clone(), cx)?;
        state = Some(frame.state());
        frames.push(WorkResult::new(frame.stages, &heard, machine));
    }
    Ok(FastReport {
        rig: PRESET.into(),
        pixels,
        calibration: report.stages,
        scene,
        frames_cpu_secs: frames.iter().map(|f| total(&f.stages)).collect(),
        frame: frames.pop().expect("the sequence has frames"),
    })
}

/// Returns the processor time of some stages, s.
fn total(stages: &[StageTime]) -> f64 {
    stages.iter().map(|s| s.cpu_secs).sum()
}

/// Returns the virtual scanner with its scene and its sequence.
fn spec() -> Result<Spec> {
    let mut spec = Spec::preset(PRESET).context("the preset is part of the simulator")?;
    if let SweepSpec::Stage { positions, .. } = &mut spec.sweep {
        *positions = POSITIONS;
    }
    spec.scenes.retain(|scene| scene.name == SCENE);
    let objects = spec.scenes.first().map(|scene| scene.objects.clone()).context("the preset has the scene")?;
    let motion = MotionSpec { velocity_mm_per_sec: [20.0, 0.0, 10.0], ..MotionSpec::default() };
    spec.sequences = vec![SequenceSpec {
        name: SCENE.into(),
        fps: 20.0,
        frames: FRAMES,
        flash_delay_secs: 0.0,
        pattern_interval_secs: 0.0,
        pattern_set: None,
        black: true,
        objects: objects.into_iter().map(|object| MovingObjectSpec { object, motion: motion.clone() }).collect(),
    }];
    Ok(spec)
}

/// Writes the stages of some work in one line.
fn write_stages(f: &mut fmt::Formatter, what: &str, stages: &[StageTime]) -> fmt::Result {
    let each: Vec<String> = stages.iter().map(|s| format!("{} {:.2}", s.name, s.cpu_secs)).collect();
    writeln!(f, "  {what} {:.2}: {}", total(stages), each.join(", "))
}

impl fmt::Display for FastReport {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(
            f,
            "Recipe fast, virtual rig {} ({} pixels of the surface), CPU s of all threads",
            self.rig, self.pixels
        )?;
        write_stages(f, "calibration", &self.calibration)?;
        self.scene.write(f, "scene")?;
        let frames: Vec<String> = self.frames_cpu_secs.iter().map(|s| format!("{s:.2}")).collect();
        writeln!(f, "  frames of a sequence, the first one anew: {}", frames.join(", "))?;
        self.frame.write(f, "the last frame")
    }
}
