//! Reading a result folder back, as far as an evaluation or the next frame of a sequence needs.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use nelu3d_scan::input::read_text;
use nelu3d_scan::{Camera, npy};

use super::summary::CameraJson;
use crate::sensor::CrosstalkMatrix;
use crate::sequence::{FrameState, PatternTime};

/// The error of a result folder that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The folder is no result folder.
    #[error(
        "{}: is no result folder: it has no result.json; give the folder that a reconstruction wrote",
        path.display()
    )]
    NotAResult {
        /// The path given.
        path: PathBuf,
    },
    /// result.json cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        source: io::Error,
    },
    /// result.json cannot be used.
    #[error("{}: {problem}; write the result again", path.display())]
    Summary {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// An array cannot be read.
    #[error(transparent)]
    Array(#[from] npy::NpyError),
    /// A map has another size than the camera's images.
    #[error(
        "{}: has shape {found:?}, but the result's camera has {height} rows of {width} pixels; write the result again",
        path.display()
    )]
    Shape {
        /// The file.
        path: PathBuf,
        /// Its shape.
        found: Vec<usize>,
        /// Width of the camera's images.
        width: usize,
        /// Height of the camera's images.
        height: usize,
    },
}

/// The content of a result folder. Maps are `height × width` of the camera.
#[derive(Clone, Debug)]
pub struct SavedResult {
    /// The camera of the maps.
    pub camera: Camera,
    /// Camera z, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// Unit normals, when the folder has them.
    pub normals: Option<Vec<[f32; 3]>>,
    /// 1σ of the depth, mm, when the folder has it.
    pub sigma: Option<Vec<f32>>,
}

/// The part of result.json that every evaluation needs.
#[derive(serde::Deserialize)]
struct Head {
    camera: CameraJson,
}

impl SavedResult {
    /// Reads a result folder.
    ///
    /// # Errors
    ///
    /// It is no result folder, or one of its files is broken.
    pub fn read(dir: &Path) -> Result<Self, ReadError> {
        let camera = read_json::<Head>(dir)?.camera.camera().ok_or_else(|| {
            let problem = "its camera has an unknown lens distortion".to_owned();
            ReadError::Summary { path: dir.join("result.json"), problem }
        })?;
        let optional = |name: &str, depth: &[usize]| -> Result<Option<Vec<f32>>, ReadError> {
            let path = dir.join(name);
            if path.exists() { read_map(&path, &camera, depth).map(Some) } else { Ok(None) }
        };
        let normals = optional("normals.npy", &[3])?.map(|n| n.as_chunks::<3>().0.to_vec());
        let sigma = optional("sigma.npy", &[])?;
        Ok(Self { depth: read_map(&dir.join("depth.npy"), &camera, &[])?, normals, sigma, camera })
    }
}

/// The part of a frame's result.json from which the next frame starts.
#[derive(serde::Deserialize)]
struct FrameRecord {
    method: FrameMethod,
}

/// The part of `method` in a frame's result.json.
#[derive(serde::Deserialize)]
struct FrameMethod {
    #[serde(default, rename = "mixing", alias = "crosstalk")]
    crosstalk: Option<CrosstalkMatrix>,
    motion: FrameMotion,
}

/// The part of `motion` in a frame's result.json.
#[derive(serde::Deserialize)]
struct FrameMotion {
    pattern_time: Option<PatternTime>,
}

/// Reads, from its result folder, what a frame of a sequence left for the next one.
///
/// # Errors
///
/// It is no result folder, one of its files is broken, or it is no frame of a sequence.
pub fn read_frame_state(dir: &Path) -> Result<FrameState, ReadError> {
    let depth = SavedResult::read(dir)?.depth;
    let FrameMethod { crosstalk, motion } = read_json::<FrameRecord>(dir)?.method;
    Ok(FrameState { depth, pattern_time: motion.pattern_time, crosstalk })
}

/// Reads a part of a result folder's result.json.
fn read_json<T: serde::de::DeserializeOwned>(dir: &Path) -> Result<T, ReadError> {
    let path = dir.join("result.json");
    let text = read_text(&path).map_err(|e| match e.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => ReadError::NotAResult { path: dir.to_owned() },
        _ => ReadError::File { path: path.clone(), source: e },
    })?;
    serde_json::from_str(&text).map_err(|e| ReadError::Summary { path, problem: e.to_string() })
}

/// Reads an array of `height × width × tail` values.
fn read_map(path: &Path, camera: &Camera, tail: &[usize]) -> Result<Vec<f32>, ReadError> {
    let array = npy::read(path)?;
    let (width, height) = (camera.width, camera.height);
    if array.shape[..] != [&[height, width], tail].concat()[..] {
        return Err(ReadError::Shape { path: path.to_owned(), found: array.shape, width, height });
    }
    Ok(array.data)
}
