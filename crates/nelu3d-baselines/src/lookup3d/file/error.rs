//! Why a table could not be read or written.

use std::io;
use std::path::PathBuf;

/// Why a table could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The file is missing, or the system would not let it be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file could not be written; the message names it.
    #[error(transparent)]
    Write(#[from] io::Error),
    /// No table, or a damaged one.
    #[error("{}: is no lookup table that can be used ({reason}); {remedy}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
        /// What to do.
        remedy: &'static str,
    },
    /// It belongs to another camera or pattern set.
    #[error(
        "{}: the table is for {found}, the rig and its pattern set want {wanted}; export one with `nelu3d table export`, or \
         choose the right pattern set", path.display()
    )]
    Other {
        /// The file.
        path: PathBuf,
        /// What the table is for.
        found: String,
        /// What the file should be for.
        wanted: String,
    },
    /// It does not fit in memory.
    #[error(
        "{}: the table needs {needed_mb} MB and {free_mb} MB of memory are free; export a low-rank table, or \
         one with a larger setting `stride`", path.display()
    )]
    Memory {
        /// The file.
        path: PathBuf,
        /// What the table needs, MB.
        needed_mb: u64,
        /// What there is.
        free_mb: u64,
    },
}
