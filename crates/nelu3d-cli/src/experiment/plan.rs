//! From an experiment to commands, and from their answers to the values of its cells.

use std::path::{Path, PathBuf};

use anyhow::Result;
use nelu3d::result::SavedResult;
use nelu3d_evaluate::compare;
use nelu3d_scan::Rig;
use nelu3d_scan::rig::Shot;
use serde_json::{Value, json};

use super::cell::ExperimentCell;
use super::file::{Case, Experiment, Method, plain};
use super::names::{slug, words};
use super::placeholders::Placeholders;
use super::rig::{prepare_rig, with_calibrated_projector};
use super::step::{CommandStep, StepRunner};
use crate::paths::shown;

/// Runs everything that an experiment asks for.
pub(super) fn run(
    experiment: &Experiment,
    root: &Path,
    dir: &Path,
    runner: &mut StepRunner<'_>,
) -> Result<Vec<ExperimentCell>> {
    let n_values = experiment.vary.as_ref().map_or(1, |v| v.values.len());
    let mut cells: Vec<ExperimentCell> = Vec::new();
    for (case_index, case) in experiment.cases.iter().enumerate() {
        for value in 0..n_values {
            for (seed_index, &seed) in experiment.seeds.iter().enumerate() {
                let placeholders = Placeholders { experiment, case, value, seed };
                let first = cells.len();
                for (method_index, method) in experiment.methods.iter().enumerate() {
                    let here = method.cases.is_empty() || method.cases.contains(&case.label);
                    if !here || method.seeds.is_some_and(|n| seed_index >= n) {
                        continue;
                    }
                    let mut name = vec![slug(&case.label)];
                    if let Some(v) = &experiment.vary {
                        name.push(slug(&plain(&v.values[value])));
                    }
                    name.extend([slug(&method.label), seed.to_string()]);
                    let mut cell = ExperimentCell {
                        case: case_index,
                        value,
                        seed,
                        method: method_index,
                        folder: dir.join("results").join(name.join("-")),
                        scene: PathBuf::new(),
                        commands: Vec::new(),
                        document: Err(String::new()),
                    };
                    cell.document = fill(&placeholders, case, method, root, &mut cell, runner)?;
                    cells.push(cell);
                }
                if let Some(label) = &experiment.against {
                    compare_with(label, experiment, &mut cells[first..])?;
                }
            }
        }
    }
    Ok(cells)
}

/// What a cell's commands are made from.
struct CellPlan<'a> {
    placeholders: &'a Placeholders<'a>,
    case: &'a Case,
    method: &'a Method,
    rig: Rig,
    rig_dir: PathBuf,
    /// What identifies the content of the rig.
    rig_key: String,
    /// Name of the pattern set.
    set: String,
    /// The frame in the middle of a sequence, which is evaluated as a whole and shown by that frame.
    middle: Option<Shot>,
}

/// Runs the commands of a cell: makes the rig, calibrates, runs the method, and aligns the CAD model where columns ask
/// for it. Returns what the columns look into, or why there is none.
fn fill(
    placeholders: &Placeholders<'_>,
    case: &Case,
    method: &Method,
    root: &Path,
    cell: &mut ExperimentCell,
    runner: &mut StepRunner<'_>,
) -> Result<Result<Value, String>> {
    let source = &placeholders.experiment.rigs[&case.rig];
    let mut prepared = prepare_rig(placeholders, &case.rig, source, root, cell, runner)?;
    if let (Ok((dir, key)), Some(options)) = (&prepared, &method.projector) {
        prepared = with_calibrated_projector((dir, key), &placeholders.words(options), cell, runner)?;
    }
    let (rig_dir, rig_key) = match prepared {
        Ok(rig) => rig,
        Err(reason) => return Ok(Err(reason)),
    };
    let rig = Rig::open(&rig_dir)?;
    let set = rig.pattern_set(method.set.as_deref().or(case.set.as_deref()))?.name.clone();
    let mut run = placeholders.words(&method.run);
    let command = run.remove(0);
    let middle = match command.as_str() {
        "sequence" => {
            let frames = rig.sequence(&case.scene)?;
            Some(frames[frames.len() / 2].clone())
        }
        _ => None,
    };
    cell.scene = match &middle {
        Some(frame) => frame.dir.clone(),
        None => rig.scene(&case.scene)?.dir,
    };
    let plan = CellPlan { placeholders, case, method, rig, rig_dir, rig_key, set, middle };

    let (calibrate, field) = plan.calibration(runner);
    let calibrated = if method.projector.is_some() {
        None
    } else {
        match cell.run(&calibrate, runner)? {
            Ok(outcome) => Some(outcome),
            // Decoders take no more than the range of depths from a field.
            Err(_) if command == "decode" => None,
            Err(reason) => return Ok(Err(format!("calibrate: {reason}"))),
        }
    };
    let step = plan.method(&command, run, &field, &calibrate, cell, runner);
    let made = match cell.run(&step, runner)? {
        Ok(outcome) => outcome,
        Err(reason) => return Ok(Err(reason)),
    };
    if let Some(frame) = &plan.middle {
        cell.folder = cell.folder.join(&frame.name);
    }
    let mut document = json!({
        "result": made.answer[if plan.middle.is_some() { "mean" } else { "summary" }],
        "calibrate": calibrated.as_ref().map(|c| &c.answer),
        "step": { "wall_secs": made.wall_secs, "calibrate_wall_secs": calibrated.as_ref().map(|c| c.wall_secs) },
    });
    if placeholders.experiment.columns.iter().any(|c| c.value.starts_with("cad."))
        && let Ok(outcome) = cell.run(&plan.cad(cell, &step), runner)?
    {
        document["cad"] = outcome.answer;
    }
    Ok(Ok(document))
}

impl CellPlan<'_> {
    /// Returns the step that makes the color field, and the field. Decoders use it too, for the volume they look in.
    fn calibration(&self, runner: &StepRunner<'_>) -> (CommandStep, PathBuf) {
        let (rig_dir, set) = (&self.rig_dir, &self.set);
        let extra = self.placeholders.words(&self.method.calibrate);
        let field = match extra.is_empty() {
            true => rig_dir.join("fields").join(format!("{set}.safetensors")),
            false => rig_dir.join("fields").join(format!("{set}-{}.safetensors", slug(&extra.join("-")))),
        };
        // An experiment measures what is bad, too.
        let mut arguments = words(&["calibrate", &shown(rig_dir), "--set", set, "-o", &shown(&field), "--accept"]);
        arguments.extend(extra);
        arguments.extend(runner.device());
        let step = CommandStep {
            what: format!("calibrate {} {set}", self.rig.name),
            arguments,
            output: Some(field.clone()),
            inputs: vec![self.rig_key.clone()],
        };
        (step, field)
    }

    /// Returns the step that makes the result; `run` are the method's own arguments.
    fn method(
        &self,
        command: &str,
        run: Vec<String>,
        field: &Path,
        calibrate: &CommandStep,
        cell: &ExperimentCell,
        runner: &StepRunner<'_>,
    ) -> CommandStep {
        let mut arguments = words(&[command, &shown(&self.rig_dir), &self.case.scene, "--set", &self.set, "--accept"]);
        if command == "reconstruct" || command == "sequence" {
            arguments.extend(words(&["--field", &shown(field)]));
            arguments.extend(runner.device());
        }
        // Trainings take hours: what is interrupted goes on.
        let trained = ["paper", "turbosl"].iter().any(|word| run.iter().any(|w| w == word));
        arguments.extend(run);
        if trained {
            arguments.extend(words(&["--checkpoint", &format!("{}.checkpoint", shown(&cell.folder))]));
        }
        let truth = cell.scene.join("truth");
        match truth.exists() {
            true if self.middle.is_some() => arguments.push("--truth".into()),
            true => arguments.extend(words(&["--truth", &shown(&truth)])),
            false => {}
        }
        arguments.extend(words(&["-o", &shown(&cell.folder)]));
        CommandStep {
            what: format!("{}: {}", self.case.label, self.method.label),
            arguments,
            output: Some(cell.folder.clone()),
            inputs: vec![calibrate.key()],
        }
    }

    /// Returns the step that evaluates the result against the CAD model of the scene.
    fn cad(&self, cell: &ExperimentCell, result: &CommandStep) -> CommandStep {
        let mesh = cell.scene.join("truth").join("mesh.ply");
        CommandStep {
            what: format!("{}: {} against the CAD model", self.case.label, self.method.label),
            arguments: words(&["evaluate", &shown(&cell.folder), "--cad", &shown(&mesh), "--no-align"]),
            output: None,
            inputs: vec![result.key()],
        }
    }
}

/// Adds to each cell how its result differs from that of one method.
fn compare_with(label: &str, experiment: &Experiment, cells: &mut [ExperimentCell]) -> Result<()> {
    let reference = cells.iter().find(|c| experiment.methods[c.method].label == label && c.document.is_ok());
    let Some(reference) = reference.map(|c| SavedResult::read(&c.folder)).transpose()? else { return Ok(()) };
    for cell in cells {
        let folder = cell.folder.clone();
        if let Ok(document) = &mut cell.document {
            let ours = SavedResult::read(&folder)?;
            if ours.depth.len() == reference.depth.len() {
                document["against"] = json!(compare(&ours.depth, &reference.depth));
            }
        }
    }
    Ok(())
}
