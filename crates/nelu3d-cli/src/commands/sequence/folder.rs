//! The folder of a sequence's results: what is done, what failed, and with which settings.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use nelu3d::result::read_frame_state;
use nelu3d::sequence::FrameState;
use nelu3d_scan::input::read_text;
use nelu3d_scan::output::{OutputDir, create_dir, write_atomic};
use nelu3d_scan::rig::Shot;
use serde_json::Value;

use crate::paths::shown;

/// File of the settings that every frame of the folder was made with.
const SETTINGS: &str = "settings.json";

/// A folder of results, one per frame.
pub(super) struct SequenceFolder {
    root: PathBuf,
}

impl SequenceFolder {
    /// Opens or creates the folder. Frames of one folder have the same settings: others are refused.
    pub(super) fn open(root: &Path, settings: &Value) -> Result<Self> {
        let path = root.join(SETTINGS);
        if path.exists() {
            let text = read_text(&path).with_context(|| format!("{}: cannot be read", shown(&path)))?;
            let there: Value = serde_json::from_str(&text)
                .with_context(|| format!("{}: is broken; give another folder with -o", shown(&path)))?;
            if there != *settings {
                bail!(
                    "{}: holds frames that were made with other settings ({}); give another folder with -o, or delete it",
                    shown(root),
                    differences(&there, settings).join(", ")
                );
            }
        } else if root.is_dir() && std::fs::read_dir(root)?.next().is_some() {
            bail!(
                "{}: the folder exists and holds no sequence (it has no {SETTINGS}); choose another with -o",
                shown(root)
            );
        }
        create_dir(root)?;
        write_atomic(&path, |w| Ok(serde_json::to_writer_pretty(w, settings)?))?;
        Ok(Self { root: root.to_owned() })
    }

    /// Returns the folder itself.
    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Returns where a frame's result is.
    pub(super) fn frame(&self, frame: &Shot) -> PathBuf {
        self.root.join(&frame.name)
    }

    /// Returns whether a frame's result is there. It appears whole or not at all.
    pub(super) fn is_done(&self, frame: &Shot) -> bool {
        self.frame(frame).join("result.json").is_file()
    }

    /// Begins a frame's result and removes what a killed run has left of it: two runs never work on one frame at a time
    /// unless told to.
    pub(super) fn start(&self, frame: &Shot) -> Result<OutputDir> {
        let begins = format!(".{}.partial-", frame.name);
        for entry in std::fs::read_dir(&self.root)?.flatten() {
            if entry.file_name().to_string_lossy().starts_with(&begins) {
                std::fs::remove_dir_all(entry.path())
                    .with_context(|| format!("{}: cannot be removed", shown(&entry.path())))?;
            }
        }
        Ok(OutputDir::create(&self.frame(frame), "result.json")?)
    }

    /// Reads what a frame left for the next; `None` if it failed.
    pub(super) fn state(&self, frame: &Shot) -> Result<Option<FrameState>> {
        Ok(if self.is_done(frame) { Some(read_frame_state(&self.frame(frame))?) } else { None })
    }

    /// Reads the result.json of a frame that is done.
    pub(super) fn summary(&self, frame: &Shot) -> Result<Value> {
        let path = self.frame(frame).join("result.json");
        let text = read_text(&path).with_context(|| format!("{}: cannot be read", shown(&path)))?;
        serde_json::from_str(&text).with_context(|| format!("{}: is broken; delete the frame's folder", shown(&path)))
    }

    /// Returns the file that says why a frame failed.
    fn failure_file(&self, frame: &Shot) -> PathBuf {
        self.root.join(format!("{}.failed.txt", frame.name))
    }

    /// Writes down why a frame has no result.
    pub(super) fn note_failure(&self, frame: &Shot, why: &str) -> Result<()> {
        Ok(write_atomic(&self.failure_file(frame), |w| writeln!(w, "{why}"))?)
    }

    /// Removes the note of a failure of a frame that has a result now.
    pub(super) fn forget_failure(&self, frame: &Shot) -> Result<()> {
        let path = self.failure_file(frame);
        if path.exists() {
            std::fs::remove_file(&path).with_context(|| format!("{}: cannot be removed", shown(&path)))?;
        }
        Ok(())
    }

    /// Returns why a frame has no result, if it was tried.
    pub(super) fn failure(&self, frame: &Shot) -> Option<String> {
        read_text(&self.failure_file(frame)).ok().map(|text| text.trim().to_owned())
    }
}

/// Returns the keys at which two objects differ.
fn differences(a: &Value, b: &Value) -> Vec<String> {
    let (Some(x), Some(y)) = (a.as_object(), b.as_object()) else { return vec!["its content".into()] };
    let mut keys: Vec<&String> = x.keys().chain(y.keys()).collect();
    keys.sort();
    keys.dedup();
    let mut all = Vec::new();
    for key in keys {
        match (x.get(key), y.get(key)) {
            (Some(u), Some(v)) if u == v => {}
            (Some(u @ Value::Object(_)), Some(v @ Value::Object(_))) => all.extend(differences(u, v)),
            _ => all.push(key.clone()),
        }
    }
    all
}
