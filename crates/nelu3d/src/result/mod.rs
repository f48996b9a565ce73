//! What a reconstruction yields, and the folder it is written to.

pub mod picture;
mod read;
mod stages;
mod summary;
mod write;

pub use read::{ReadError, Saved};
pub use stages::{StageClock, StageTime};
pub use summary::{
    About, CameraJson, DepthRange, FORMAT, Input, Machine, MeshSize, Pixels, Summary, peak_memory_bytes,
};
pub use write::{MeshFiles, WriteError, write, write_into};

use nelu3d_scan::{Image, Mesh};

/// Why a pixel has no depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Left {
    /// It has one.
    Kept = 0,
    /// It lies outside the calibrated volume.
    Outside = 1,
    /// One of its images is clipped.
    Clipped = 2,
    /// Too dark, or in shadow.
    Dark = 3,
    /// No consistent code: nothing in the calibrated volume explains what was seen.
    Ambiguous = 4,
    /// Next to a depth jump, where a pixel sees two surfaces.
    Edge = 5,
}

impl Left {
    /// All of them, in the order of their numbers.
    pub const ALL: [Left; 6] = [Left::Kept, Left::Outside, Left::Clipped, Left::Dark, Left::Ambiguous, Left::Edge];

    /// The key of `result.json`.
    pub fn key(self) -> &'static str {
        match self {
            Left::Kept => "kept",
            Left::Outside => "outside",
            Left::Clipped => "clipped",
            Left::Dark => "dark",
            Left::Ambiguous => "ambiguous",
            Left::Edge => "edge",
        }
    }

    /// For people.
    pub fn label(self) -> &'static str {
        match self {
            Left::Kept => "has a depth",
            Left::Outside => "outside the calibrated volume",
            Left::Clipped => "clipped",
            Left::Dark => "too dark or in shadow",
            Left::Ambiguous => "no consistent code",
            Left::Edge => "next to a depth jump",
        }
    }
}

/// A reconstructed scene, in the camera's frame. Maps are `height × width`, row by row.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    /// Width of the maps, pixels.
    pub width: usize,
    /// Height of the maps, pixels.
    pub height: usize,
    /// Camera z of the first surface at each pixel's center, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// Unit surface normals that face the camera; NaN where there is no depth.
    pub normals: Vec<[f32; 3]>,
    /// One standard deviation of the depth, mm; NaN where there is no depth.
    pub sigma: Vec<f32>,
    /// Why a pixel has no depth.
    pub left: Vec<Left>,
    /// RMS over the patterns of the residual in normalized intensity; NaN where there is no depth.
    pub residual: Vec<f32>,
    /// The learned ambient share A in [0, 1]: `I_ambient = A · I_white`, mean over channels; NaN where there is none.
    pub ambient: Vec<f32>,
    /// The flash image: texture and preview.
    pub white: Image,
    /// The surface.
    pub mesh: Mesh,
    /// What took how long, in order.
    pub stages: Vec<StageTime>,
    /// What the method wants to have on record: settings, losses, counts. Written to `result.json` as it is.
    pub info: serde_json::Map<String, serde_json::Value>,
}

impl Reconstruction {
    /// Number of pixels that have a depth.
    pub fn n_kept(&self) -> usize {
        self.depth.iter().filter(|z| z.is_finite()).count()
    }

    /// Number of pixels left out, by reason, in the order of [`Left::ALL`].
    pub fn left_counts(&self) -> [usize; 6] {
        let mut counts = [0; 6];
        for &l in &self.left {
            counts[l as usize] += 1;
        }
        counts
    }
}
