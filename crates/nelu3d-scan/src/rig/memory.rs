//! Images in memory, in place of the files of a rig folder: for callers that have arrays.
//!
//! A rig with such images reads no file: positions, scenes, and sequences are the folders of their paths. Whoever gives
//! the images keeps them; each is copied while it is read, and only then.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::image::{ImageFileError, Raw};

/// An image that lies in memory.
pub trait StoredImage: Send + Sync {
    /// Returns the image's width and height, pixels, without a copy of it.
    fn size(&self) -> (usize, usize);

    /// Returns a copy of the sensor's codes.
    fn raw(&self) -> Raw;
}

/// Images in memory, by the paths that their files would have; cheap to clone. Two are equal if they are the same.
#[derive(Clone)]
pub struct MemoryImages(Arc<BTreeMap<PathBuf, Box<dyn StoredImage>>>);

impl MemoryImages {
    /// Makes the images of a rig. Paths begin with the rig's root and lead on as those of files do:
    /// `calibration/POSITION/FILE`, `scenes/SCENE/FILE`, `sequences/SEQUENCE/FRAME/FILE`.
    pub fn new(images: impl IntoIterator<Item = (PathBuf, Box<dyn StoredImage>)>) -> Self {
        Self(Arc::new(images.into_iter().collect()))
    }

    /// Returns the image at a path.
    pub(super) fn get(&self, path: &Path) -> Option<&dyn StoredImage> {
        self.0.get(path).map(AsRef::as_ref)
    }

    /// Reads an image, which has to be of `size` = (width, height).
    pub(super) fn read(&self, path: &Path, size: (usize, usize)) -> Result<Raw, ImageFileError> {
        let path_buf = || path.to_path_buf();
        let image = self.get(path).ok_or_else(|| ImageFileError::Missing { path: path_buf() })?;
        let ((width, height), (found_width, found_height)) = (size, image.size());
        if (found_width, found_height) != size {
            return Err(ImageFileError::Size { path: path_buf(), found_width, found_height, width, height });
        }
        Ok(image.raw())
    }

    /// Returns the names of the folders in `dir`, each once.
    pub(super) fn folders(&self, dir: &Path) -> Vec<String> {
        let below = self.0.keys().filter_map(|path| {
            let mut parts = path.strip_prefix(dir).ok()?.components();
            let name = parts.next()?.as_os_str().to_string_lossy().into_owned();
            // What lies in `dir` itself is a file.
            parts.next().map(|_| name)
        });
        let mut names: Vec<String> = below.collect();
        names.dedup();
        names
    }
}

impl PartialEq for MemoryImages {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl std::fmt::Debug for MemoryImages {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_set().entries(self.0.keys()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Channels, RawData, write_png16};
    use crate::rig::{Need, PatternSet, Rig, Shot};
    use crate::{Camera, Image};

    /// A 4 × 3 image of 16-bit codes.
    struct Codes(Vec<u16>);

    impl StoredImage for Codes {
        fn size(&self) -> (usize, usize) {
            (4, self.0.len() / 4)
        }

        fn raw(&self) -> Raw {
            Raw { width: 4, height: self.0.len() / 4, channels: 1, data: RawData::U16(self.0.clone()) }
        }
    }

    fn rig(root: &Path, memory: Option<MemoryImages>) -> Rig {
        Rig {
            root: root.to_path_buf(),
            name: String::new(),
            camera: Camera::pinhole(4, 3, 5.0, 5.0, 1.5, 1.0),
            camera_file: "camera.json".into(),
            channels: Channels::Mono,
            response: None,
            black_level: 10.0,
            saturation: 1010.0,
            white: "white.png".into(),
            black: "black.png".into(),
            pattern_sets: vec![PatternSet { name: "p".into(), images: vec!["p.png".into()], inverse: Vec::new() }],
            board: None,
            poses: Vec::new(),
            projector: None,
            memory,
        }
    }

    fn images(root: &Path, rows: u16) -> MemoryImages {
        let shots = ["calibration/10", "calibration/9", "scenes/cup", "sequences/hand/0", "sequences/hand/1"];
        let names = ["white.png", "black.png", "p.png"];
        let all = shots.iter().flat_map(|shot| names.map(|name| root.join(shot).join(name))).enumerate();
        MemoryImages::new(all.map(|(i, path)| {
            let codes: Vec<u16> = (0..4 * rows).map(|p| 10 + 7 * p + i as u16).collect();
            (path, Box::new(Codes(codes)) as Box<dyn StoredImage>)
        }))
    }

    /// What is read from memory is what is read from files with the same codes.
    #[test]
    fn memory_reads_as_files_do() {
        let dir = tempfile::tempdir().unwrap();
        let memory = images(dir.path(), 3);
        for (path, image) in memory.0.iter() {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            let RawData::U16(codes) = image.raw().data else { panic!("16-bit codes") };
            let data = codes.iter().map(|c| (f32::from(*c) - 10.0) / 1000.0).collect();
            write_png16(path, &Image { width: 4, height: 3, channels: 1, data }, 10.0, 1010.0).unwrap();
        }
        let (files, memory) = (rig(dir.path(), None), rig(dir.path(), Some(memory)));
        let names = |shots: Vec<Shot>| shots.into_iter().map(|s| s.name).collect::<Vec<_>>();
        assert_eq!(names(memory.positions().unwrap()), ["9", "10"]);
        assert_eq!(memory.positions().unwrap(), files.positions().unwrap());
        assert_eq!(memory.scenes().unwrap(), files.scenes().unwrap());
        assert_eq!(names(memory.sequence("hand").unwrap()), ["0", "1"]);
        assert_eq!(memory.sequence("hand").unwrap(), files.sequence("hand").unwrap());
        let (scene, set) = (memory.scene("cup").unwrap(), memory.pattern_set(None).unwrap());
        assert_eq!(
            memory.read_shot(&scene, set, Need::Scene).unwrap(),
            files.read_shot(&scene, set, Need::Scene).unwrap()
        );
        assert!(memory.has_image(&scene.dir.join("p.png")) && !memory.has_image(&scene.dir.join("q.png")));
    }

    /// Nothing is looked for on the disk, and images of another size are refused as files are.
    #[test]
    fn what_memory_lacks_is_named() {
        let root = Path::new("arrays");
        let rig_of = |rows| rig(root, Some(images(root, rows)));
        let small = rig_of(2);
        let error = small.read_image(&root.join("scenes/cup/white.png")).unwrap_err().to_string();
        assert!(error.contains("white.png") && error.contains("4x2"), "{error}");
        let error = rig_of(3).read_image(&root.join("scenes/cup/q.png")).unwrap_err().to_string();
        assert!(error.contains("q.png") && error.contains("no such image"), "{error}");
        assert!(rig_of(3).scene("mug").unwrap_err().to_string().contains("the rig has: cup"));
    }
}
