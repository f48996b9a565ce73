//! One command of an experiment, run as a process of its own, so that its time and memory are its own, and recorded
//! when it is done, so that it need not run again.

use std::collections::HashMap;
use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use nelu3d_field::device::Choice;
use nelu3d_scan::input::{MAX_DATA, read_file, read_text};
use nelu3d_scan::output::{create_dir, write_atomic};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::context::CommandContext;

/// A command and what it depends on.
#[derive(Clone, Debug)]
pub(super) struct CommandStep {
    /// Name that is shown while it runs.
    pub what: String,
    /// Arguments of this program.
    pub arguments: Vec<String>,
    /// File or folder that it writes; `None` if it only answers.
    pub output: Option<PathBuf>,
    /// Everything else that decides its outcome: contents of files, keys of other steps.
    pub inputs: Vec<String>,
}

/// What a command answered, and how long it took.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct StepOutcome {
    /// The arguments.
    pub arguments: Vec<String>,
    /// Hash of the program that ran it.
    program: String,
    /// Elapsed time, s.
    pub wall_secs: f64,
    /// Its answer.
    pub answer: Value,
}

/// Runs commands, each once.
pub(super) struct StepRunner<'a> {
    context: &'a CommandContext,
    notes: PathBuf,
    program: Vec<OsString>,
    program_hash: String,
    device: Choice,
    /// Whether outcomes of another build of the program are good enough.
    reuse: bool,
    failed: HashMap<String, String>,
    /// Number of commands that ran.
    pub ran: usize,
    /// Number of commands whose earlier outcome was reused.
    pub reused: usize,
}

impl<'a> StepRunner<'a> {
    /// Creates a runner whose records are in `root/steps`.
    pub(super) fn new(root: &Path, device: Choice, reuse: bool, context: &'a CommandContext) -> Result<Self> {
        let notes = root.join("steps");
        create_dir(&notes)?;
        let program = context.program.command()?;
        let code = context.program.code()?;
        let content = read_file(&code, MAX_DATA).with_context(|| format!("{}: cannot be read", code.display()))?;
        let program_hash = hex(&content);
        Ok(Self { context, notes, program, program_hash, device, reuse, failed: HashMap::new(), ran: 0, reused: 0 })
    }

    /// Returns the arguments that choose this experiment's device; none for the default.
    pub(super) fn device(&self) -> Vec<String> {
        match self.device {
            Choice::Auto => Vec::new(),
            device => vec!["--device".into(), device.to_string()],
        }
    }

    /// Returns the outcome of a command: from an earlier run of the same command on the same inputs, or from running
    /// it. `Ok(Err(reason))` if the command fails.
    pub(super) fn run(&mut self, step: &CommandStep) -> Result<Result<StepOutcome, String>> {
        let key = step.key();
        if let Some(reason) = self.failed.get(&key) {
            return Ok(Err(reason.clone()));
        }
        let note = self.notes.join(format!("{key}.json"));
        if let Some(outcome) = self.recorded(&note, step) {
            self.reused += 1;
            return Ok(Ok(outcome));
        }
        self.context.progress.stage(&step.what);
        let start = Instant::now();
        let mut command = Command::new(&self.program[0]);
        command.args(&self.program[1..]).args(&step.arguments).args(["--json", "--quiet"]).stdin(Stdio::null());
        command.args(["--threads", &rayon::current_num_threads().to_string()]);
        let done = self.output(&mut command)?;
        self.context.stop_if_asked()?;
        self.ran += 1;
        if !done.status.success() {
            let said = String::from_utf8_lossy(&done.stderr);
            let reason = said.lines().rev().find(|l| !l.trim().is_empty()).unwrap_or("it says nothing");
            let reason = reason.trim_start_matches("nelu3d: ").to_owned();
            if done.status.code() == Some(2) {
                bail!("`nelu3d {}` is not understood: {}", step.arguments.join(" "), said.trim());
            }
            self.failed.insert(key, reason.clone());
            return Ok(Err(reason));
        }
        let answer = serde_json::from_slice(&done.stdout).context("a command's answer is no JSON")?;
        let outcome = StepOutcome {
            arguments: step.arguments.clone(),
            program: self.program_hash.clone(),
            wall_secs: start.elapsed().as_secs_f64(),
            answer,
        };
        let text = serde_json::to_vec_pretty(&outcome)?;
        write_atomic(&note, |w| w.write_all(&text))?;
        Ok(Ok(outcome))
    }

    /// Runs a command to its end, or until this program is asked to stop: then the command is, too.
    fn output(&self, command: &mut Command) -> Result<Output> {
        const POLL: Duration = Duration::from_millis(10);
        let started = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let mut child = started.with_context(|| format!("{}: cannot be started", self.program[0].display()))?;
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        std::thread::scope(|scope| {
            let stdout = scope.spawn(|| read_to_end(stdout));
            let stderr = scope.spawn(|| read_to_end(stderr));
            let mut told = false;
            let status = loop {
                if let Some(status) = child.try_wait()? {
                    break status;
                }
                if self.context.progress.cancelled() && !told {
                    told = true;
                    ask_to_end(&mut child);
                }
                std::thread::sleep(POLL);
            };
            let read = |thread: std::thread::ScopedJoinHandle<'_, Vec<u8>>| thread.join().unwrap_or_default();
            Ok(Output { status, stdout: read(stdout), stderr: read(stderr) })
        })
    }

    /// Reads the recorded outcome of a command, if it is still good.
    fn recorded(&self, note: &Path, step: &CommandStep) -> Option<StepOutcome> {
        let outcome: StepOutcome = serde_json::from_str(&read_text(note).ok()?).ok()?;
        let there = step.output.as_ref().is_none_or(|o| o.exists());
        (there && (self.reuse || outcome.program == self.program_hash)).then_some(outcome)
    }
}

impl CommandStep {
    /// Returns what identifies the command: a hash of its arguments and inputs.
    pub(super) fn key(&self) -> String {
        let mut all = self.arguments.join("\0");
        for input in &self.inputs {
            all += "\0\0";
            all += input;
        }
        hex(all.as_bytes())[..24].to_owned()
    }
}

fn read_to_end(pipe: Option<impl Read>) -> Vec<u8> {
    let mut all = Vec::new();
    // What cannot be read any more is what a command said until then.
    let _ = pipe.map(|mut pipe| pipe.read_to_end(&mut all));
    all
}

/// Asks a command to end as it ends itself: without leaving anything half written.
fn ask_to_end(child: &mut Child) {
    #[cfg(unix)]
    let _ = rustix::process::kill_process(rustix::process::Pid::from_child(child), rustix::process::Signal::TERM);
    #[cfg(not(unix))]
    let _ = child.kill();
}

/// Returns the SHA-256, hexadecimal.
pub(super) fn hex(content: &[u8]) -> String {
    Sha256::digest(content).iter().map(|b| format!("{b:02x}")).collect()
}
