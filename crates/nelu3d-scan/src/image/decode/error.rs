//! Why an image file could not be used.

use std::io;
use std::path::{Path, PathBuf};

/// Why an image file could not be used.
#[derive(Debug, thiserror::Error)]
pub enum ImageFileError {
    /// The file is missing.
    #[error("{}: there is no such image; capture it, or correct the name in rig.toml", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// It is no regular file, is too large, or the operating system would not let it be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        source: io::Error,
    },
    /// Not PNG, TIFF, EXR or JPEG.
    #[error("{}: is neither PNG, TIFF, OpenEXR nor JPEG; save it as one of the first three, without loss", path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// Truncated or damaged.
    #[error(
        "{}: cannot be decoded ({reason}): the file is truncated or damaged; copy or capture it again",
        path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// A valid image of a kind that no capture has.
    #[error("{}: {problem}; {remedy}", path.display())]
    Kind {
        /// The file.
        path: PathBuf,
        /// What it is.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
    /// Another size than the camera's.
    #[error(
        "{}: is {found_width}x{found_height} pixels, but its intrinsics say {width}x{height}; \
         use the images that belong to these intrinsics, or correct the intrinsics", path.display()
    )]
    Size {
        /// The file.
        path: PathBuf,
        /// Width found, px.
        found_width: usize,
        /// Height found, px.
        found_height: usize,
        /// Width expected, px.
        width: usize,
        /// Height expected, px.
        height: usize,
    },
}

impl ImageFileError {
    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        match self {
            ImageFileError::Missing { path }
            | ImageFileError::Io { path, .. }
            | ImageFileError::Format { path }
            | ImageFileError::Damaged { path, .. }
            | ImageFileError::Kind { path, .. }
            | ImageFileError::Size { path, .. } => path,
        }
    }
}
