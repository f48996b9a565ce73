//! Frames that are read while the one before is computed, with the motion between their white images.
//!
//! Each image is read and decoded once, though a white image serves three frames: its own and both neighbors'. Errors
//! wait for the turn of the frame they belong to. One frame waits ready, and of the one after it the white image is
//! read: no more is ever held.

use std::collections::BTreeMap;
use std::sync::mpsc::SyncSender;

use anyhow::{Context as _, Result};
use nelu3d::Progress;
use nelu3d::result::Input;
use nelu3d::sequence::{MotionMode, Neighbors, Plan};
use nelu3d_evaluate::GroundTruth;
use nelu3d_scan::rig::{Capture, PatternSet, Shot, ShotReader};
use nelu3d_scan::{Image, Rig};

use crate::paths::shown;

/// All that a frame is made from, except what the previous frame leaves.
pub(super) struct ReadFrame {
    /// The images.
    pub(super) capture: Capture,
    /// The white images of the neighboring frames.
    pub(super) neighbors: Neighbors,
    /// The files of its capture, hashed.
    pub(super) inputs: Vec<Input>,
    /// The ground truth, where it was asked for.
    pub(super) truth: Option<GroundTruth>,
}

/// Reads frames one after the other, ahead of the computation.
pub(super) struct ReadAhead<'a> {
    pub(super) rig: &'a Rig,
    pub(super) set: &'a PatternSet,
    pub(super) frames: &'a [Shot],
    pub(super) plan: Plan,
    /// How motion is compensated; where it is not, frames come without the white images of their neighbors.
    pub(super) motion: MotionMode,
    /// Whether frames come with their ground truth.
    pub(super) with_truth: bool,
    /// White images that a frame to come needs, with the reader that goes on with the other images of their folder.
    pub(super) whites: BTreeMap<usize, ReadWhite<'a>>,
}

/// A white image that was read.
pub(super) struct ReadWhite<'a> {
    image: Image,
    rest: ShotReader<'a>,
}

impl<'a> ReadAhead<'a> {
    /// Reads the frames of these rising numbers, and hands each over with its number. It ends early when the receiver
    /// is dropped or the user stops the work.
    pub(super) fn run(mut self, todo: &[usize], to: &SyncSender<(usize, Result<ReadFrame>)>, progress: &Progress) {
        for (n, &i) in todo.iter().enumerate() {
            let frame = self.frame(i, progress);
            // Before it is handed over, which is when this thread waits.
            let next = todo.get(n + 1).copied().unwrap_or(usize::MAX);
            self.whites.retain(|&j, _| j + 1 >= next);
            if progress.cancelled() || to.send((i, frame)).is_err() {
                return;
            }
        }
    }

    /// Reads one frame.
    fn frame(&mut self, i: usize, progress: &Progress) -> Result<ReadFrame> {
        let shot = &self.frames[i];
        let truth =
            self.with_truth.then(|| GroundTruth::read(&shot.dir.join("truth"), &self.rig.camera)).transpose()?;
        let ReadWhite { image: white, mut rest } = match self.whites.remove(&i) {
            Some(white) => white,
            None => self.read_white(i)?,
        };
        anyhow::ensure!(!progress.cancelled(), "stopped");
        let black = shot.dir.join(&self.rig.black).exists().then(|| rest.read(&self.rig.black)).transpose()?;
        let (mut patterns, mut mono) = (Vec::new(), Vec::new());
        for name in &self.set.images {
            anyhow::ensure!(!progress.cancelled(), "stopped");
            let (pattern, is_mono) = rest.read_pattern(name, &white, black.as_ref())?;
            patterns.push(pattern);
            mono.push(is_mono);
        }
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
        // A frame that is no keyframe nearly always starts from the previous one.
        if self.motion == MotionMode::Auto || !self.plan.is_key(i) {
            neighbors.motion(&white);
        }
        if self.motion != MotionMode::Off {
            // For the frame after this one.
            self.whites.insert(i, ReadWhite { image: white.clone(), rest });
        }
        Ok(ReadFrame { capture: Capture { white, black, patterns, mono }, neighbors, inputs, truth })
    }

    /// Returns the white image of a neighboring frame; a neighbor that cannot be read is none, and fails when its turn
    /// comes.
    fn neighbor(&mut self, i: usize) -> Option<Image> {
        if !self.whites.contains_key(&i) {
            let white = self.read_white(i).ok()?;
            self.whites.insert(i, white);
        }
        self.whites.get(&i).map(|white| white.image.clone())
    }

    /// Reads a frame's white image.
    fn read_white(&self, i: usize) -> Result<ReadWhite<'a>> {
        let mut rest = self.rig.reader(&self.frames[i]);
        Ok(ReadWhite { image: rest.read(&self.rig.white)?, rest })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nelu3d_scan::image::{Image, write_gray8, write_png16};
    use nelu3d_scan::rig::Need;

    use super::*;

    const SIZE: [usize; 2] = [40, 30];

    fn save(path: &Path, shift: usize) {
        let [w, h] = SIZE;
        let data: Vec<u8> = (0..w * h).map(|i| (20 + 5 * ((i % w + shift) % 40) + i / w) as u8).collect();
        write_gray8(path, w, h, &data).unwrap();
    }

    /// Six frames of 40 × 30 px; the second has no white image, the fourth a pattern of another depth, the fifth a
    /// black image.
    fn rig(root: &Path) -> Rig {
        let toml = "format = 1\n[camera]\nchannels = \"mono\"\nblack_level = 0\nsaturation = 255\n[[pattern_sets]]\n\
                    name = \"a\"\nimages = [\"a0.png\", \"a1.png\"]\n";
        std::fs::write(root.join("rig.toml"), toml).unwrap();
        let camera = r#"{ "resx": 40, "resy": 30, "K": [[50, 0, 20], [0, 50, 15], [0, 0, 1]], "dist_coeffs": [] }"#;
        std::fs::write(root.join("camera.json"), camera).unwrap();
        for i in 0..6 {
            let dir = root.join(format!("sequences/s/{i:03}"));
            std::fs::create_dir_all(&dir).unwrap();
            for (n, name) in ["white.png", "a0.png", "a1.png"].iter().enumerate() {
                save(&dir.join(name), 10 * i + n);
            }
            match i {
                1 => std::fs::remove_file(dir.join("white.png")).unwrap(),
                3 => {
                    let [width, height] = SIZE;
                    let image = Image { width, height, channels: 1, data: vec![9000.0; width * height] };
                    write_png16(&dir.join("a1.png"), &image, 0.0, 1.0).unwrap();
                }
                4 => save(&dir.join("black.png"), 7),
                _ => {}
            }
        }
        Rig::open(root).unwrap()
    }

    /// Frames are what they are when read alone, and so are their errors.
    #[test]
    fn a_frame_read_ahead_is_the_frame() {
        let dir = tempfile::tempdir().unwrap();
        let rig = rig(dir.path());
        let set = rig.pattern_set(Some("a")).unwrap();
        let frames = rig.sequence("s").unwrap();
        for (motion, todo) in [(MotionMode::Auto, vec![0, 1, 2, 3, 4, 5]), (MotionMode::Off, vec![1, 2, 4])] {
            let plan = Plan { frames: 6, keyframe: 2 };
            let ahead =
                ReadAhead { rig: &rig, set, frames: &frames, plan, motion, with_truth: false, whites: BTreeMap::new() };
            let (to, read) = std::sync::mpsc::sync_channel(0);
            let numbers = &todo;
            std::thread::scope(|scope| {
                scope.spawn(move || ahead.run(numbers, &to, &Progress::none()));
                for &i in &todo {
                    let (number, frame) = read.recv().unwrap();
                    assert_eq!(number, i);
                    match (frame, rig.read_shot(&frames[i], set, Need::Frame)) {
                        (Ok(frame), Ok(capture)) => {
                            assert!(frame.capture == capture && i != 1 && i != 3, "{i}");
                            assert_eq!((capture.black.is_some(), frame.inputs.len()), (i == 4, 3), "{i}");
                        }
                        (Err(ahead), Err(alone)) => {
                            assert_eq!(ahead.to_string(), alone.to_string());
                            assert!(i == 1 || i == 3, "{i}: {alone}");
                        }
                        (ahead, alone) => panic!("{i}: {:?} ahead, {:?} alone", ahead.err(), alone.err()),
                    }
                }
                assert!(read.recv().is_err(), "that was all");
            });
        }
    }

    /// A reader that nobody listens to anymore ends, and so does one that is stopped.
    #[test]
    fn the_reader_ends_with_the_work() {
        use std::sync::Arc;
        use std::sync::atomic::AtomicBool;
        struct Nobody;
        impl nelu3d::progress::Sink for Nobody {
            fn stage(&self, _: &str) {}
            fn tick(&self, _: usize, _: usize) {}
            fn warn(&self, _: &str) {}
        }
        let dir = tempfile::tempdir().unwrap();
        let rig = rig(dir.path());
        let (set, frames) = (rig.pattern_set(Some("a")).unwrap(), rig.sequence("s").unwrap());
        for stopped in [false, true] {
            let progress = Progress::new(Arc::new(Nobody), Arc::new(AtomicBool::new(stopped)));
            let (plan, motion) = (Plan { frames: 6, keyframe: 6 }, MotionMode::Auto);
            let (rig, frames) = (&rig, &frames[..]);
            let ahead = ReadAhead { rig, set, frames, plan, motion, with_truth: false, whites: BTreeMap::new() };
            let (to, read) = std::sync::mpsc::sync_channel(0);
            std::thread::scope(|scope| {
                scope.spawn(|| ahead.run(&[0, 2, 4, 5], &to, &progress));
                if !stopped {
                    assert_eq!(read.recv().unwrap().0, 0);
                }
                drop(read);
            });
        }
    }
}
