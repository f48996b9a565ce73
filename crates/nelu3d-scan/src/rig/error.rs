//! Why a rig folder could not be used.

use std::io;
use std::path::{Path, PathBuf};

use crate::camera::CameraFileError;
use crate::image::{Depth, ImageFileError};

/// Why a rig folder could not be used.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The path has no rig.toml.
    #[error("{}: is no rig: it has no rig.toml; give the folder of a rig, or write its rig.toml", path.display())]
    NotARig {
        /// The path given.
        path: PathBuf,
    },
    /// A file or folder could not be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The path.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        source: io::Error,
    },
    /// A file or folder could not be written; the message names it.
    #[error(transparent)]
    Write(#[from] io::Error),
    /// rig.toml is not valid TOML, has an unknown key or a value of another type.
    #[error("{}: cannot be understood: {reason}; correct the file", path.display())]
    Syntax {
        /// The rig.toml.
        path: PathBuf,
        /// What the parser said, with the line.
        reason: String,
    },
    /// rig.toml was written for a newer program.
    #[error("{}: `format` is {found}, but this program knows up to {known}; update the program", path.display())]
    NewerFormat {
        /// The rig.toml.
        path: PathBuf,
        /// Its version.
        found: i64,
        /// The newest version known.
        known: i64,
    },
    /// A value in rig.toml that makes no sense.
    #[error("{}: `{key}` {problem}; {remedy}", path.display())]
    Invalid {
        /// The rig.toml.
        path: PathBuf,
        /// The key.
        key: String,
        /// What is wrong with its value.
        problem: String,
        /// What to do about it.
        remedy: String,
    },
    /// The camera or projector file.
    #[error(transparent)]
    Camera(#[from] CameraFileError),
    /// An image.
    #[error(transparent)]
    Image(#[from] ImageFileError),
    /// Images of one shot have different bit depths.
    #[error(
        "{}: is {depth}, but {} is {other_depth}; capture one folder's images with one setting",
        path.display(), other.display()
    )]
    MixedDepth {
        /// A file.
        path: PathBuf,
        /// Its depth.
        depth: Depth,
        /// The file read before it.
        other: PathBuf,
        /// The depth of that one.
        other_depth: Depth,
    },
    /// Images of one name are mono in one folder and colored in another.
    #[error(
        "{}: has {} where {} has {}; take this pattern the same way everywhere",
        path.display(), if *mono { "one channel" } else { "three channels" },
        other.display(), if *mono { "three" } else { "one" }
    )]
    MixedChannels {
        /// A file.
        path: PathBuf,
        /// Whether it has one channel.
        mono: bool,
        /// What was read first under its name.
        other: PathBuf,
    },
    /// No such pattern set.
    #[error(
        "{}: has no pattern set{}; {}", path.display(),
        name.as_ref().map(|n| format!(" `{n}`")).unwrap_or_default(),
        if known.is_empty() {
            "add a [[pattern_sets]] with name and images".into()
        } else {
            format!("it has: {}", known.join(", "))
        }
    )]
    NoPatternSet {
        /// The rig.toml.
        path: PathBuf,
        /// The name asked for.
        name: Option<String>,
        /// The names there are.
        known: Vec<String>,
    },
    /// No such scene or sequence.
    #[error(
        "{}: no {what} `{name}`; {}", path.display(),
        if known.is_empty() {
            format!("the rig has none: put one into {what}s/, or give the path of a folder")
        } else {
            format!("the rig has: {}; or give the path of a folder", known.join(", "))
        }
    )]
    NoShot {
        /// The rig.
        path: PathBuf,
        /// "scene" or "sequence".
        what: &'static str,
        /// The name asked for.
        name: String,
        /// The names there are.
        known: Vec<String>,
    },
    /// A folder without the folders it should have.
    #[error("{}: {problem}; {remedy}", path.display())]
    Empty {
        /// The folder.
        path: PathBuf,
        /// What is missing.
        problem: &'static str,
        /// What to do about it.
        remedy: &'static str,
    },
}

impl RigError {
    /// Returns the file or folder concerned; `None` where only the message names it.
    pub fn path(&self) -> Option<&Path> {
        match self {
            RigError::NotARig { path }
            | RigError::Io { path, .. }
            | RigError::Syntax { path, .. }
            | RigError::NewerFormat { path, .. }
            | RigError::Invalid { path, .. }
            | RigError::MixedDepth { path, .. }
            | RigError::MixedChannels { path, .. }
            | RigError::NoPatternSet { path, .. }
            | RigError::NoShot { path, .. }
            | RigError::Empty { path, .. } => Some(path),
            RigError::Camera(e) => Some(e.path()),
            RigError::Image(e) => Some(e.path()),
            RigError::Write(_) => None,
        }
    }
}
