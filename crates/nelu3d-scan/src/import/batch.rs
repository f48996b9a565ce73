//! Frames on their way into the rig, in parallel.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::frame::{self, Frame, Kind, Mean};
use super::levels::Codes;
use super::order::Slots;
use super::{ImportError, frames, store};
use crate::image::{Raw, RawData};
use crate::output::create_dir;
use crate::rig::Rig;

/// Returns the folder of the n-th group.
pub(super) fn numbered(dir: &Path, n: usize) -> PathBuf {
    dir.join(format!("{n:04}"))
}

/// Groups on their way into the rig.
pub(super) struct Batch<'a> {
    pub rig: &'a Rig,
    pub slots: &'a Slots,
    pub groups: &'a [&'a [PathBuf]],
    pub kind: Kind,
    pub progress: &'a (dyn Fn(usize, usize) -> bool + Sync),
}

impl Batch<'_> {
    /// Puts every group into its own folder under `dir`; returns the codes that occurred, and the folders.
    pub(super) fn all(&self, dir: &Path) -> Result<(Codes, Vec<PathBuf>), ImportError> {
        let done = AtomicUsize::new(0);
        let folders: Vec<PathBuf> = (0..self.groups.len()).map(|i| numbered(dir, i)).collect();
        let codes = folders
            .par_iter()
            .enumerate()
            .map(|(i, folder)| self.group(i, folder, &done))
            .try_reduce(Codes::default, |a, b| Ok(a.and(b)))?;
        Ok((codes, folders))
    }

    /// Puts the i-th group into `dir`.
    pub(super) fn group(&self, i: usize, dir: &Path, done: &AtomicUsize) -> Result<Codes, ImportError> {
        create_dir(dir)?;
        let mut codes = Codes::default();
        for (slot, file) in self.slots.iter().zip(self.groups[i]) {
            if let Some(name) = slot {
                let frame = self.read(file)?;
                codes = codes.and(Codes::of(&frame.raw));
                store::put(&frame, &dir.join(name))?;
            }
            self.tick(done)?;
        }
        Ok(codes)
    }

    /// Puts the mean of all groups into `dir`.
    pub(super) fn average(&self, dir: &Path) -> Result<Codes, ImportError> {
        create_dir(dir)?;
        let done = AtomicUsize::new(0);
        let one = |(i, slot): (usize, &Option<String>)| {
            let Some(name) = slot else { return Ok(Codes::default()) };
            let files: Vec<&PathBuf> = self.groups.iter().map(|g| &g[i]).collect();
            let (mean, codes) = self.mean(&files, &done)?;
            store::write(&mean, &dir.join(name))?;
            Ok::<_, ImportError>(codes)
        };
        self.slots.par_iter().enumerate().map(one).try_reduce(Codes::default, |a, b| Ok(a.and(b)))
    }

    /// Returns the image with the light off: `path`, or the mean of the images in it.
    pub(super) fn black(&self, path: &Path) -> Result<(Raw, Codes), ImportError> {
        let files = if path.is_dir() { frames::list(path, None, None)? } else { vec![path.to_path_buf()] };
        let files: Vec<&PathBuf> = files.iter().collect();
        if let [one] = files[..] {
            let raw = self.read(one)?.raw;
            let codes = Codes::of(&raw);
            return Ok((raw, codes));
        }
        self.mean(&files, &AtomicUsize::new(0))
    }

    fn mean(&self, files: &[&PathBuf], done: &AtomicUsize) -> Result<(Raw, Codes), ImportError> {
        let (mut mean, mut codes, mut like) = (Mean::new(), Codes::default(), None);
        for file in files {
            let frame = self.read(file)?;
            codes = codes.and(Codes::of(&frame.raw));
            mean.add(&frame)?;
            like.get_or_insert(Raw { data: empty_like(&frame.raw.data), ..frame.raw });
            self.tick(done)?;
        }
        let like = like.expect("a mean of one image or more");
        Ok((mean.finish(&like), codes))
    }

    fn read(&self, file: &Path) -> Result<Frame, ImportError> {
        let frame = frame::read(file, (self.rig.camera.width, self.rig.camera.height))?;
        self.kind.check(&frame)?;
        // Channels, and numbers that are none; a new rig's saturation is not known yet.
        frame.raw.check_kind(file, self.rig.channels, 0.0)?;
        Ok(frame)
    }

    /// Reports another frame as done.
    fn tick(&self, done: &AtomicUsize) -> Result<(), ImportError> {
        let total = self.groups.len() * self.slots.len();
        let now = done.fetch_add(1, Ordering::Relaxed) + 1;
        if (self.progress)(now.min(total), total) { Ok(()) } else { Err(ImportError::Stopped) }
    }
}

fn empty_like(data: &RawData) -> RawData {
    match data {
        RawData::U8(_) => RawData::U8(Vec::new()),
        RawData::U16(_) => RawData::U16(Vec::new()),
        RawData::Float(_) => RawData::Float(Vec::new()),
    }
}
