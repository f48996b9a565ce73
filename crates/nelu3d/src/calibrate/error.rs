//! Errors of a calibration.

use std::path::PathBuf;

use nelu3d_field::device::DeviceError;
use nelu3d_field::field::FieldError;
use nelu3d_scan::board::BoardError;
use nelu3d_scan::pose::PoseError;
use nelu3d_scan::rig::RigError;

/// The error of a calibration.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// The rig folder or one of its images cannot be used.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The board's description cannot be used.
    #[error("{path}: {source}")]
    Board {
        /// The rig.toml.
        path: PathBuf,
        /// What is wrong.
        source: BoardError,
    },
    /// The poses of the boards cannot be solved.
    #[error("{path}: {source}")]
    Pose {
        /// The calibration folder.
        path: PathBuf,
        /// What is wrong.
        source: PoseError,
    },
    /// The rig describes no board.
    #[error("{0}: [board] is missing; describe the target of the sweep, or make the field from a calibrated projector")]
    NoBoard(PathBuf),
    /// A position to be left out does not exist.
    #[error("{path}: there is no board position {name} to leave out; there are {known}")]
    NoPosition {
        /// The calibration folder.
        path: PathBuf,
        /// The name that was given.
        name: String,
        /// The names that there are.
        known: String,
    },
    /// Too few board positions are usable.
    #[error("{path}: {found} usable board positions, and at least 3 are needed; capture more{reasons}")]
    TooFew {
        /// The calibration folder.
        path: PathBuf,
        /// Number of usable positions.
        found: usize,
        /// Why other positions were not usable.
        reasons: String,
    },
    /// No sample is usable.
    #[error("{path}: {reason}")]
    NoSamples {
        /// The calibration folder.
        path: PathBuf,
        /// Why no sample is usable.
        reason: String,
    },
    /// The projector's data are missing or do not fit.
    #[error("{path}: {reason}")]
    Projector {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The device that was asked for is not there.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The sizes of form `published` make no field.
    #[error("form `published`: {0}")]
    Published(#[from] FieldError),
    /// The caller stopped the work.
    #[error("stopped before the color field was finished; nothing was written")]
    Cancelled,
}
