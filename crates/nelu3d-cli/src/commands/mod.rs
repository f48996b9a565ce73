//! One module per command: what was typed becomes what it means, then the library does the work.

pub(crate) mod bench;
pub(crate) mod calibrate;
pub(crate) mod check;
pub(crate) mod decode;
pub(crate) mod demo;
pub(crate) mod devices;
pub(crate) mod evaluate;
pub(crate) mod import;
pub(crate) mod job;
pub(crate) mod patterns;
pub(crate) mod projector;
pub(crate) mod reconstruct;
pub(crate) mod sequence;
pub(crate) mod simulate;
pub(crate) mod table;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::Result;
use nelu3d::Progress;
use nelu3d::color_field::ColorField;
use nelu3d::color_field::check_field;
use nelu3d_field::device::{self, Choice, Device};
use nelu3d_scan::Rig;
use nelu3d_scan::rig::PatternSet;

use crate::console::Console;

/// What every command gets.
pub(crate) struct Context {
    /// Where work reports to, and hears that it should stop.
    pub progress: Progress,
    console: Arc<Console>,
    cancel: Arc<AtomicBool>,
    json: bool,
}

/// Shows nothing.
struct Unseen;

impl nelu3d::progress::Sink for Unseen {
    fn stage(&self, _: &str) {}
    fn tick(&self, _: usize, _: usize) {}
    fn warn(&self, message: &str) {
        tracing::warn!("{message}");
    }
}

impl Context {
    /// A context that reports to `console`.
    pub(crate) fn new(console: Arc<Console>, cancel: Arc<AtomicBool>, json: bool) -> Self {
        Self { progress: Progress::new(console.clone(), cancel.clone()), console, cancel, json }
    }

    /// Opens the device that work will be done on, before it begins, and says which it is.
    pub(crate) fn open_device(&self, choice: Choice) -> Result<()> {
        let device = Device::open(choice)?;
        match (choice, device.is_cpu()) {
            (Choice::Auto, true) if device::has_gpu_code() => {
                self.console.note("no GPU: everything is done on the CPU (`nelu3d devices` says why)");
            }
            (_, false) => self.console.note(&format!("on {}", device.name())),
            _ => {}
        }
        Ok(())
    }

    /// Progress that nobody sees, of work that stops when this does.
    pub(crate) fn silent(&self) -> Progress {
        Progress::new(Arc::new(Unseen), self.cancel.clone())
    }

    /// Fails if Ctrl-C was pressed: the last chance before an output is put into place.
    pub(crate) fn stop_if_asked(&self) -> Result<()> {
        if self.progress.cancelled() { Err(anyhow::anyhow!("stopped")) } else { Ok(()) }
    }

    /// Ends the last stage and prints the answer of a command on standard output: `text` for people, or `json`.
    pub(crate) fn answer(&self, json: &impl serde::Serialize, text: impl FnOnce() -> String) -> Result<()> {
        use std::io::Write;
        self.console.finish();
        let answer = if self.json { serde_json::to_string_pretty(json)? } else { text() };
        match writeln!(std::io::stdout().lock(), "{}", answer.trim_end()) {
            // `nelu3d … | head` has seen enough.
            Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
            written => Ok(written?),
        }
    }
}

/// Where `calibrate` writes the color field of a set, and `reconstruct` looks for it.
fn default_field(rig: &Rig, set: &str) -> PathBuf {
    rig.root.join("fields").join(format!("{set}.safetensors"))
}

/// The color field of a set, which must be there and belong to the rig.
fn load_field(rig: &Rig, set: &PatternSet, path: &Path) -> Result<ColorField> {
    if !path.exists() {
        anyhow::bail!(
            "{}: there is no color field; run `nelu3d calibrate {} --set {}` first, or give one with --field",
            shown(path),
            shown(&rig.root),
            set.name
        );
    }
    let field = ColorField::load(path)?;
    // The library has a field, not a file.
    check_field(rig, set, &field).map_err(|e| anyhow::anyhow!("{}: {e}", shown(path)))?;
    Ok(field)
}

/// Where `reconstruct` writes the result of a scene.
fn default_result(rig: &Rig, scene: &str, set: &str) -> PathBuf {
    rig.root.join("results").join(format!("{scene}-{set}"))
}

/// A path as it should be shown.
fn shown(path: &Path) -> String {
    path.display().to_string()
}
