//! Frames as they arrive in a folder.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use nelu3d_scan::Rig;
use nelu3d_scan::rig::{PatternSet, Shot, natural_order};

use crate::paths::shown;

/// A frame is complete when all of its images are there and none has grown for so long.
const SETTLED: Duration = Duration::from_millis(80);

/// The frames of a folder, which may still be growing, or not be there yet.
pub(super) struct Arrivals<'a> {
    rig: &'a Rig,
    set: &'a PatternSet,
    folder: PathBuf,
    /// Complete frames in the order of their names, and when each was found complete.
    complete: Vec<(Shot, Instant)>,
    /// Frames that are not yet complete: name, sizes of their images, and since when they have them.
    growing: Vec<(String, Vec<u64>, Instant)>,
}

/// The newest frame of a folder.
#[derive(Clone)]
pub(super) struct Newest {
    pub(super) frame: Shot,
    /// When it was found complete.
    pub(super) at: Instant,
    /// The frame before it, if there is one.
    pub(super) before: Option<Shot>,
    /// Complete frames that came after the one asked from, itself among them.
    pub(super) new: usize,
}

impl<'a> Arrivals<'a> {
    /// Looks at no frame yet. `folder` need not exist.
    pub(super) fn new(rig: &'a Rig, set: &'a PatternSet, folder: PathBuf) -> Self {
        Self { rig, set, folder, complete: Vec::new(), growing: Vec::new() }
    }

    /// Returns the folder.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns how many frames are complete.
    pub(super) fn count(&self) -> usize {
        self.complete.len()
    }

    /// Looks at the folder, and returns its newest complete frame if it comes after the one named `after`.
    ///
    /// # Errors
    ///
    /// The folder cannot be read.
    pub(super) fn newest(&mut self, after: Option<&str>) -> Result<Option<Newest>> {
        self.look()?;
        let last = self.complete.len();
        let comes_after = |shot: &Shot| after.is_none_or(|after| natural_order(&shot.name, after).is_gt());
        let new = self.complete.iter().rev().take_while(|(shot, _)| comes_after(shot)).count();
        Ok((new > 0).then(|| {
            let (frame, at) = self.complete[last - 1].clone();
            Newest { frame, at, before: (last > 1).then(|| self.complete[last - 2].0.clone()), new }
        }))
    }

    /// Moves frames whose images are all there and have settled to those that are complete.
    fn look(&mut self) -> Result<()> {
        let now = Instant::now();
        let mut growing = Vec::new();
        for name in self.names()? {
            let known = self.complete.binary_search_by(|(shot, _)| natural_order(&shot.name, &name));
            let Err(place) = known else { continue };
            let dir = self.folder.join(&name);
            let Some(sizes) = self.sizes(&dir) else { continue };
            let before = self.growing.iter().find(|(n, s, _)| *n == name && *s == sizes);
            let since = before.map_or(now, |(_, _, since)| *since);
            if now - since >= SETTLED {
                self.complete.insert(place, (Shot { name, dir }, now));
            } else {
                growing.push((name, sizes, since));
            }
        }
        self.growing = growing;
        Ok(())
    }

    /// Returns the names of the folder's folders; hidden ones are under construction.
    fn names(&self) -> Result<Vec<String>> {
        if !self.folder.exists() {
            return Ok(Vec::new());
        }
        let unreadable = || format!("{}: cannot be read", shown(&self.folder));
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&self.folder).with_context(unreadable)? {
            let entry = entry.with_context(unreadable)?;
            let name = entry.file_name().to_string_lossy().into_owned();
            if !name.starts_with('.') && entry.path().is_dir() {
                names.push(name);
            }
        }
        Ok(names)
    }

    /// Returns the sizes of a frame's images, bytes; `None` as long as one is missing or empty. The black image, which
    /// a frame may do without, counts where it is.
    fn sizes(&self, dir: &Path) -> Option<Vec<u64>> {
        let size = |name: &str| std::fs::metadata(dir.join(name)).map(|m| m.len()).ok();
        let needed = std::iter::once(&self.rig.white).chain(&self.set.images);
        let mut sizes: Vec<u64> = needed.map(|name| size(name).filter(|n| *n > 0)).collect::<Option<_>>()?;
        sizes.push(size(&self.rig.black).unwrap_or(0));
        Some(sizes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_complete_when_their_images_are() {
        let dir = tempfile::tempdir().unwrap();
        let toml = "format = 1\n[camera]\nchannels = \"mono\"\nblack_level = 0\nsaturation = 255\n[[pattern_sets]]\n\
                    name = \"a\"\nimages = [\"a0.png\", \"a1.png\"]\n";
        std::fs::write(dir.path().join("rig.toml"), toml).unwrap();
        let camera = r#"{ "resx": 4, "resy": 3, "K": [[5, 0, 2], [0, 5, 1], [0, 0, 1]], "dist_coeffs": [] }"#;
        std::fs::write(dir.path().join("camera.json"), camera).unwrap();
        let rig = Rig::open(dir.path()).unwrap();
        let folder = dir.path().join("sequences/s");
        let mut arrivals = Arrivals::new(&rig, rig.pattern_set(None).unwrap(), folder.clone());
        assert!(arrivals.newest(None).unwrap().is_none(), "there is no folder yet");

        let write = |frame: &str, image: &str, bytes: usize| {
            std::fs::create_dir_all(folder.join(frame)).unwrap();
            std::fs::write(folder.join(frame).join(image), vec![0; bytes]).unwrap();
        };
        let settled = |arrivals: &mut Arrivals<'_>, after: Option<&str>| {
            arrivals.newest(after).unwrap();
            std::thread::sleep(2 * SETTLED);
            arrivals.newest(after).unwrap()
        };
        for frame in ["8", "9"] {
            ["white.png", "a0.png", "a1.png"].iter().for_each(|image| write(frame, image, 100));
        }
        write("10", "white.png", 100);
        write("10", "a0.png", 100);
        write(".11", "white.png", 100);
        let newest = settled(&mut arrivals, None).expect("two frames are complete");
        assert_eq!((newest.frame.name.as_str(), newest.new), ("9", 2));
        assert_eq!(newest.before.map(|shot| shot.name).as_deref(), Some("8"));
        assert!(settled(&mut arrivals, Some("9")).is_none(), "the tenth lacks an image");

        // An image that is being written, then the rest of it.
        write("10", "a1.png", 10);
        assert!(arrivals.newest(Some("9")).unwrap().is_none());
        write("10", "a1.png", 100);
        let newest = settled(&mut arrivals, Some("9")).expect("all of it is there");
        assert_eq!((newest.frame.name.as_str(), newest.new, arrivals.count()), ("10", 1, 3));
        assert!(arrivals.newest(Some("10")).unwrap().is_none());
    }
}
