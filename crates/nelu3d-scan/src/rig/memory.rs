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
