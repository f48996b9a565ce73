//! The ground truth of a scene.

use std::path::{Path, PathBuf};

use nelu3d_scan::Camera;
use nelu3d_scan::image::{Channels, ImageFileError, decode};
use nelu3d_scan::npy::{self, NpyError};

/// The ground truth of a scene, as a `truth/` folder has it. Maps are `height × width`, row by row.
#[derive(Clone, Debug)]
pub struct GroundTruth {
    /// Width of the maps, pixels.
    pub width: usize,
    /// Height of the maps, pixels.
    pub height: usize,
    /// Depth (camera z) of the first surface, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// Whether the depth is finite and the light source reaches the point.
    pub mask: Vec<bool>,
}

/// Ground truth that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum GroundTruthError {
    /// The folder holds no ground truth.
    #[error("{}: is no ground truth: it has no {missing}; give a folder with depth.npy and mask.png", path.display())]
    NotGroundTruth {
        /// The path given.
        path: PathBuf,
        /// The file it lacks.
        missing: &'static str,
    },
    /// `depth.npy` cannot be read.
    #[error(transparent)]
    Array(#[from] NpyError),
    /// `mask.png` cannot be read.
    #[error(transparent)]
    Image(#[from] ImageFileError),
    /// `depth.npy` has another size than the camera's images.
    #[error(
        "{}: has shape {found:?}, but the camera has {height} rows of {width} pixels; give the ground truth of this camera",
        path.display()
    )]
    Shape {
        /// The file that has it.
        path: PathBuf,
        /// Shape of the array that was found, rows first.
        found: Vec<usize>,
        /// Width of the camera's images.
        width: usize,
        /// Height of the camera's images.
        height: usize,
    },
}

impl GroundTruth {
    /// Reads `depth.npy` and `mask.png` of a folder. A pixel of the mask whose depth is not finite is not counted.
    ///
    /// # Errors
    ///
    /// A file is missing, broken or has another size than the camera's images.
    pub fn read(dir: &Path, camera: &Camera) -> Result<Self, GroundTruthError> {
        for missing in ["depth.npy", "mask.png"] {
            if !dir.join(missing).is_file() {
                return Err(GroundTruthError::NotGroundTruth { path: dir.to_owned(), missing });
            }
        }
        let (width, height) = (camera.width, camera.height);
        let path = dir.join("depth.npy");
        let depth = npy::read(&path)?;
        if depth.shape != [height, width] {
            return Err(GroundTruthError::Shape { path, found: depth.shape, width, height });
        }
        let path = dir.join("mask.png");
        let mask = decode(&path, Some((width, height)))?.linearize(&path, Channels::Mono, 0.0, 255.0)?;
        let lit = |i: usize| mask.data[i] >= 0.5 && depth.data[i].is_finite();
        Ok(Self { width, height, mask: (0..width * height).map(lit).collect(), depth: depth.data })
    }
}
