//! One cell of an experiment: one method on one case, with one value and one seed.

use std::path::PathBuf;

use anyhow::Result;
use serde_json::Value;

use super::step::{CommandStep, StepOutcome, StepRunner};

/// One method on one case, with one value and one seed.
#[derive(Clone, Debug)]
pub(super) struct ExperimentCell {
    /// Index of the case.
    pub case: usize,
    /// Index of the varied value.
    pub value: usize,
    /// The seed.
    pub seed: u64,
    /// Index of the method.
    pub method: usize,
    /// The result folder.
    pub folder: PathBuf,
    /// The scene's folder.
    pub scene: PathBuf,
    /// The commands that made it, in order.
    pub commands: Vec<String>,
    /// The values that columns take their numbers from, or why there are none.
    pub document: Result<Value, String>,
}

impl ExperimentCell {
    /// Runs a step and notes its command.
    pub(super) fn run(
        &mut self,
        step: &CommandStep,
        runner: &mut StepRunner<'_>,
    ) -> Result<Result<StepOutcome, String>> {
        self.commands.push(format!("nelu3d {}", step.arguments.join(" ")));
        runner.run(step)
    }
}
