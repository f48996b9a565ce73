//! Why there is no lookup table to decode with.

use std::path::PathBuf;

use nelu3d::calibrate::CalibrationError;
use nelu3d::result::ReadError;

use super::file::FileError;

/// Why there is no lookup table to decode with.
#[derive(Debug, thiserror::Error)]
pub enum LookupTableError {
    /// The sweep cannot be used.
    #[error(transparent)]
    Calibrate(#[from] CalibrationError),
    /// The file of a table cannot be used.
    #[error(transparent)]
    File(#[from] FileError),
    /// The result of the previous frame cannot be read.
    #[error(transparent)]
    Previous(#[from] ReadError),
    /// The result of the previous frame is of another camera.
    #[error(
        "{}: a result of {found} pixels, but the camera has {wanted}; give a result of the same rig as setting `previous`",
        path.display()
    )]
    PreviousSize {
        /// The result's folder.
        path: PathBuf,
        /// Width × height of the result.
        found: String,
        /// Width × height of the camera.
        wanted: String,
    },
    /// The table needs more memory than is free.
    #[error(
        "the lookup table needs {needed_mb} MB and {available_mb} MB of memory are free; keep every {stride}th pixel with \
         setting `stride` {stride}"
    )]
    Memory {
        /// Memory that the table needs, MB.
        needed_mb: u64,
        /// Memory that it may have, MB.
        available_mb: u64,
        /// A stride with which it fits.
        stride: usize,
    },
    /// A stride out of range.
    #[error("setting `stride` {0} is not possible; give a number from 1 to 16, less than the picture's sides")]
    Stride(usize),
}
