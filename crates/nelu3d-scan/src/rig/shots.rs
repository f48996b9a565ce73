//! The folders of a rig: positions, scenes, sequences.

use std::cmp::Ordering;
use std::path::Path;

use super::{Rig, RigError, Shot};
use crate::input::explain;

impl Rig {
    /// Returns the board positions of the sweep, in order: sorted by name, numbers in names by value (`9` before `10`).
    ///
    /// # Errors
    ///
    /// The rig has no `calibration/`, or it has no folders.
    pub fn positions(&self) -> Result<Vec<Shot>, RigError> {
        let dir = self.root.join("calibration");
        let shots = self.folders(&dir)?;
        if shots.is_empty() {
            return Err(RigError::Empty {
                path: dir,
                problem: "the rig has no calibration sweep",
                remedy: "put one folder per board position there",
            });
        }
        Ok(shots)
    }

    /// Returns all scenes, sorted by name.
    ///
    /// # Errors
    ///
    /// `scenes/` exists and cannot be read.
    pub fn scenes(&self) -> Result<Vec<Shot>, RigError> {
        self.folders(&self.root.join("scenes"))
    }

    /// Returns all sequences' folders, sorted by name.
    ///
    /// # Errors
    ///
    /// `sequences/` exists and cannot be read.
    pub fn sequences(&self) -> Result<Vec<Shot>, RigError> {
        self.folders(&self.root.join("sequences"))
    }

    /// Returns a scene: a name under `scenes/`, or the path of any folder with the same files.
    ///
    /// # Errors
    ///
    /// There is no such folder; the message lists the scenes there are.
    pub fn scene(&self, name: &str) -> Result<Shot, RigError> {
        self.find(self.scenes()?, "scene", name)
    }

    /// Returns the frames of a sequence, in order (as [`Rig::positions`] sorts): a name under `sequences/`, or the path
    /// of any folder of frames.
    ///
    /// # Errors
    ///
    /// There is no such folder, or it has no frames; the message lists the sequences there are.
    pub fn sequence(&self, name: &str) -> Result<Vec<Shot>, RigError> {
        self.frames(self.find(self.sequences()?, "sequence", name)?)
    }

    /// Returns the frames of a sequence's folder, in order.
    ///
    /// # Errors
    ///
    /// The folder cannot be read or has no frames.
    pub(super) fn frames(&self, sequence: Shot) -> Result<Vec<Shot>, RigError> {
        let frames = self.folders(&sequence.dir)?;
        if frames.is_empty() {
            return Err(RigError::Empty {
                path: sequence.dir,
                problem: "the sequence has no frames",
                remedy: "put one folder per frame there",
            });
        }
        Ok(frames)
    }

    /// Returns the folders in `dir`, sorted. There are none if `dir` is missing.
    fn folders(&self, dir: &Path) -> Result<Vec<Shot>, RigError> {
        let Some(memory) = &self.memory else { return folders(dir) };
        let names = memory.folders(dir).into_iter();
        let mut shots: Vec<Shot> = names.map(|name| Shot { dir: dir.join(&name), name }).collect();
        shots.sort_by(|a, b| natural_order(&a.name, &b.name));
        Ok(shots)
    }

    /// Returns one of the folders `known` by its name, or any folder of files by its path.
    fn find(&self, known: Vec<Shot>, what: &'static str, name: &str) -> Result<Shot, RigError> {
        match known.iter().find(|s| s.name == name) {
            Some(shot) => Ok(shot.clone()),
            None if self.memory.is_some() => Err(no_shot(&self.root, known, what, name)),
            None => find(&self.root, known, what, name),
        }
    }
}

fn find(root: &Path, known: Vec<Shot>, what: &'static str, name: &str) -> Result<Shot, RigError> {
    let dir = Path::new(name);
    if !name.is_empty() && dir.is_dir() {
        // `.` and `..` have no name of their own.
        let full = dir.canonicalize().map_err(|e| RigError::Io { path: dir.to_path_buf(), source: explain(&e) })?;
        let name = full.file_name().map_or_else(|| what.to_owned(), |n| n.to_string_lossy().into_owned());
        return Ok(Shot { name, dir: dir.to_path_buf() });
    }
    Err(no_shot(root, known, what, name))
}

fn no_shot(root: &Path, known: Vec<Shot>, what: &'static str, name: &str) -> RigError {
    let known = known.into_iter().map(|s| s.name).collect();
    RigError::NoShot { path: root.to_path_buf(), what, name: name.into(), known }
}

/// Returns the folders in `dir`, sorted; hidden ones (a result under construction, say) are skipped. There are none if
/// `dir` is missing.
fn folders(dir: &Path) -> Result<Vec<Shot>, RigError> {
    let io = |e: std::io::Error| RigError::Io { path: dir.to_path_buf(), source: explain(&e) };
    if !dir.exists() {
        return Ok(Vec::new());
    }
    let mut shots = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() && !name.starts_with('.') {
            shots.push(Shot { name, dir: path });
        }
    }
    shots.sort_by(|a, b| natural_order(&a.name, &b.name));
    Ok(shots)
}

/// Compares names with runs of digits compared as numbers, so that unpadded names keep the order of the sweep.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a, b);
    while let (Some(p), Some(q)) = (x.chars().next(), y.chars().next()) {
        let order = if p.is_ascii_digit() && q.is_ascii_digit() {
            let (m, n) = (take_digits(&mut x), take_digits(&mut y));
            m.len().cmp(&n.len()).then(m.cmp(n))
        } else {
            x = &x[p.len_utf8()..];
            y = &y[q.len_utf8()..];
            p.cmp(&q)
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    x.len().cmp(&y.len()).then(a.cmp(b))
}

/// Splits the leading digits off `s`; returns them without leading zeros.
fn take_digits<'a>(s: &mut &'a str) -> &'a str {
    let n = s.bytes().take_while(u8::is_ascii_digit).count();
    let (digits, rest) = s.split_at(n);
    *s = rest;
    digits.trim_start_matches('0')
}
