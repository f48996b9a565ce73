//! The frames to come, read while the one before is computed, and the motion that their flashes show.
//!
//! Each image is read and decoded once, though a flash serves three frames: its own and both neighbors'. Errors wait for the turn of the
//! frame they belong to. One frame waits ready and the one after it has its flash read: no more is ever held.

use std::collections::BTreeMap;
use std::sync::mpsc::SyncSender;

use anyhow::{Context as _, Result};
use nelu3d::Progress;
use nelu3d::evaluate::Truth;
use nelu3d::result::Input;
use nelu3d::sequence::{MotionMode, Neighbors, Plan};
use nelu3d_scan::rig::{Capture, PatternSet, Shot, ShotReader};
use nelu3d_scan::{Image, Rig};

use super::super::shown;

/// All that a frame is made from, but for what the frame before it leaves.
pub(super) struct Frame {
    pub(super) capture: Capture,
    pub(super) neighbors: Neighbors,
    /// The files of its capture, hashed.
    pub(super) inputs: Vec<Input>,
    /// Where it was asked for.
    pub(super) truth: Option<Truth>,
}

/// Reads frames one after the other.
pub(super) struct Ahead<'a> {
    pub(super) rig: &'a Rig,
    pub(super) set: &'a PatternSet,
    pub(super) frames: &'a [Shot],
    pub(super) plan: Plan,
    /// What flashes of neighbors are for: frames come without them where it is nothing.
    pub(super) motion: MotionMode,
    /// Whether frames come with their truth.
    pub(super) with_truth: bool,
    /// Flashes that a frame to come needs, with the reader that goes on with the other images of their folder.
    pub(super) flashes: BTreeMap<usize, Flash<'a>>,
}

/// A flash that was read.
pub(super) struct Flash<'a> {
    image: Image,
    rest: ShotReader<'a>,
}

impl<'a> Ahead<'a> {
    /// Reads the frames of these numbers, which rise, and hands each over with its number. It ends early when nobody takes them anymore, or
    /// the user stops the work.
    pub(super) fn run(mut self, todo: &[usize], to: &SyncSender<(usize, Result<Frame>)>, progress: &Progress) {
        for (n, &i) in todo.iter().enumerate() {
            let frame = self.frame(i, progress);
            // Before it is handed over, which is when this thread waits.
            let next = todo.get(n + 1).copied().unwrap_or(usize::MAX);
            self.flashes.retain(|&j, _| j + 1 >= next);
            if progress.cancelled() || to.send((i, frame)).is_err() {
                return;
            }
        }
    }

    /// One frame.
    fn frame(&mut self, i: usize, progress: &Progress) -> Result<Frame> {
        let shot = &self.frames[i];
        let truth = self.with_truth.then(|| Truth::read(&shot.dir.join("truth"), &self.rig.camera)).transpose()?;
        let Flash { image: white, mut rest } = match self.flashes.remove(&i) {
            Some(flash) => flash,
            None => self.flash(i)?,
        };
        let mut read = |name: &str| {
            anyhow::ensure!(!progress.cancelled(), "stopped");
            Ok(rest.read(name)?)
        };
        let black = shot.dir.join(&self.rig.black).exists().then(|| read(&self.rig.black)).transpose()?;
        let patterns = self.set.images.iter().map(|name| read(name)).collect::<Result<Vec<_>>>()?;
        let mut neighbors = Neighbors::default();
        if self.motion != MotionMode::Off {
            let before = i.checked_sub(1).and_then(|j| self.neighbor(j));
            let after = (i + 1 < self.frames.len()).then(|| self.neighbor(i + 1)).flatten();
            neighbors = Neighbors::new(before, after);
        }
        let mut inputs = Vec::new();
        for name in std::iter::once(&self.rig.white).chain(&self.set.images) {
            let path = shot.dir.join(name);
            inputs.push(Input::of(&path).with_context(|| format!("{}: cannot be read", shown(&path)))?);
        }
        anyhow::ensure!(!progress.cancelled(), "stopped");
        // Where it is needed; a frame that is not the first nearly always has the one before to begin with.
        if self.motion == MotionMode::Auto || !self.plan.is_key(i) {
            neighbors.motion(&white);
        }
        if self.motion != MotionMode::Off {
            // For the frame after this one.
            self.flashes.insert(i, Flash { image: white.clone(), rest });
        }
        Ok(Frame { capture: Capture { white, black, patterns }, neighbors, inputs, truth })
    }

    /// The flash of a neighboring frame; a neighbor that cannot be read is none, and fails by itself when its turn comes.
    fn neighbor(&mut self, i: usize) -> Option<Image> {
        if !self.flashes.contains_key(&i) {
            let flash = self.flash(i).ok()?;
            self.flashes.insert(i, flash);
        }
        self.flashes.get(&i).map(|flash| flash.image.clone())
    }

    /// Reads a frame's flash.
    fn flash(&self, i: usize) -> Result<Flash<'a>> {
        let mut rest = self.rig.reader(&self.frames[i]);
        Ok(Flash { image: rest.read(&self.rig.white)?, rest })
    }
}
