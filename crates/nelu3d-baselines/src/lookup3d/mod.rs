//! LookUp3D: depth from a lookup table of the sweep itself, with no model of the light at all.
//!
//! For every camera pixel the sweep gives, at each of its P board positions, a codeword of k normalized intensities and the
//! depth of the board's plane. To decode is to find the position whose codeword is closest to the measured one, pixel by
//! pixel; what remains of the difference says how much to believe it.
//!
//! ```text
//! sweep ─► build ─► FullTable ─► compress ─► LowRank          file: .npy and .npz of the LookUp3D tools
//!                        └──────────┬──────────┘
//!     scene ─► Measurements ─► decode (search ─► interpolate ─► judge) ─► SurfaceMaps
//! ```
//!
//! Searches ([`Search`]): over all positions; coarse to fine; around an earlier result. They share the kernel
//! [`nelu3d_field::nearest`], the interpolation between positions and the judgement of what is left out.
//!
//! A sample is missing (NaN) where the board's outline or its light did not reach, or where an image is clipped; a codeword
//! that lacks one channel is missing as a whole. A missing sample is never chosen. The depth of a board's plane is kept for
//! every pixel, as the LookUp3D tools do.

mod build;
mod compress;
mod decode;
pub mod file;
mod interpolate;
mod low_rank;
mod run;
mod search;
mod table;
#[cfg(test)]
mod tests;

pub use build::{Built, build, memory_bytes};
pub use compress::{Compressed, Rank, compress};
pub use decode::{Interpolation, SurfaceMaps, Memory, Search, Settings, decode, decode_near};
pub use low_rank::LowRank;
pub use run::{Options, run};
pub use table::{FullTable, Shape, Table};

use nelu3d::calibrate;

/// Why there is no table.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The sweep cannot be used.
    #[error(transparent)]
    Calibrate(#[from] calibrate::CalibrationError),
    /// The file of a table.
    #[error(transparent)]
    File(#[from] file::FileError),
    /// The result to start from.
    #[error(transparent)]
    Previous(#[from] nelu3d::result::ReadError),
    /// The result to start from is of another camera.
    #[error("{}: a result of {found} pixels, but the camera has {wanted}; give a result of the same rig to --previous", path.display())]
    PreviousSize {
        /// The folder.
        path: std::path::PathBuf,
        /// Width × height.
        found: String,
        /// Of the camera.
        wanted: String,
    },
    /// The table is too large.
    #[error(
        "the lookup table needs {needed_mb} MB and {available_mb} MB of memory are free; keep every {step}th pixel with \
         --stride {step}"
    )]
    Memory {
        /// What it needs.
        needed_mb: u64,
        /// What there is.
        available_mb: u64,
        /// A stride with which it fits.
        step: usize,
    },
    /// A stride out of range.
    #[error("--stride {0} is not possible; give a number from 1 to 16, less than the picture's sides")]
    Step(usize),
}
