//! rig.toml: reading and writing.

mod board;
mod board_file;
mod problems;
mod response;
mod schema;
mod validate;

use std::path::{Path, PathBuf};

pub use board_file::{board_lines, read_board};
pub use response::state_response;
pub(super) use schema::RigToml;
pub(super) use validate::from_toml;

use self::schema::{FORMAT, to_toml};
use super::{PROJECTOR_FILE, RIG_FILE, Rig, RigError};
use crate::camera::{Camera, Projector, read_camera, read_projector, write_camera, write_projector};
use crate::image::decode;
use crate::input::{MAX_TEXT, read_file, toml_reason};
use crate::output::{create_dir, write_atomic};

impl Rig {
    /// Opens a rig: reads rig.toml, the intrinsics and, where there is one, the projector. No image is read.
    ///
    /// `path` is the folder or its rig.toml.
    ///
    /// # Errors
    ///
    /// No rig is there; rig.toml has an unknown key, a newer format or an impossible value; the camera or projector
    /// file is bad. The message names the file, the key and a remedy.
    pub fn open(path: &Path) -> Result<Self, RigError> {
        let (root, toml) = read_toml(path)?;
        let camera = read_camera(&root.join(&toml.camera.intrinsics))?;
        let file = root.join(PROJECTOR_FILE);
        let projector = if file.exists() { Some(read_projector(&file)?) } else { None };
        Self::checked(&root, toml, camera, projector)
    }

    /// Opens a rig whose camera is still to be calibrated: the camera has the size of the sweep's first white image, and
    /// intrinsics that are none. What is at the place of the camera's file is not read, nor is a projector.
    ///
    /// # Errors
    ///
    /// As [`Rig::open`], for rig.toml; or there is no sweep, or its first white image cannot be read.
    pub fn open_uncalibrated(path: &Path) -> Result<Self, RigError> {
        let mut rig = Self::open_sensor(path)?;
        let positions = rig.positions()?;
        // No rig has a sweep without positions.
        let first = positions.first().map(|shot| shot.dir.join(&rig.white)).unwrap_or_default();
        let raw = decode(&first, None)?;
        let (w, h) = (raw.width as f64, raw.height as f64);
        rig.camera = Camera::pinhole(raw.width, raw.height, w, w, 0.5 * (w - 1.0), 0.5 * (h - 1.0));
        Ok(rig)
    }

    /// Opens a rig of whose camera only codes and channels are asked for: the intrinsics are none, and neither their file
    /// nor a projector's is read.
    ///
    /// # Errors
    ///
    /// As [`Rig::open`], for rig.toml.
    pub fn open_sensor(path: &Path) -> Result<Self, RigError> {
        let (root, toml) = read_toml(path)?;
        Self::checked(&root, toml, Camera::pinhole(1, 1, 1.0, 1.0, 0.0, 0.0), None)
    }

    /// Makes the rig of the folder `root` from the content of its rig.toml, its camera and its projector. No file is
    /// read, but for the camera's response where rig.toml names one.
    ///
    /// # Errors
    ///
    /// As [`Rig::open`], for rig.toml.
    pub fn from_bytes(
        root: &Path,
        bytes: Vec<u8>,
        camera: Camera,
        projector: Option<Projector>,
    ) -> Result<Self, RigError> {
        Self::checked(root, parse(&root.join(RIG_FILE), bytes)?, camera, projector)
    }

    fn checked(root: &Path, toml: RigToml, camera: Camera, projector: Option<Projector>) -> Result<Self, RigError> {
        let (rig, problems) = from_toml(root, toml, camera, projector);
        match problems.into_iter().next() {
            Some(first) => Err(first),
            None => Ok(rig),
        }
    }

    /// Writes rig.toml, the intrinsics and, where there is one, the projector into [`Rig::root`], which is created.
    ///
    /// # Errors
    ///
    /// A file cannot be written, or the rig holds a value that could not be read back.
    pub fn save(&self) -> Result<(), RigError> {
        let path = self.root.join(RIG_FILE);
        let text = toml::to_string(&to_toml(self))
            .map_err(|e| RigError::Syntax { path: path.clone(), reason: e.to_string() })?;
        // What cannot be opened again must not be written either.
        let (_, problems) = from_toml(&self.root, to_toml(self), self.camera.clone(), self.projector.clone());
        if let Some(first) = problems.into_iter().next() {
            return Err(first);
        }
        create_dir(&self.root)?;
        write_atomic(&path, |w| w.write_all(text.as_bytes()))?;
        write_camera(&self.root.join(&self.camera_file), &self.camera)?;
        if let Some(projector) = &self.projector {
            write_projector(&self.root.join(PROJECTOR_FILE), projector)?;
        }
        Ok(())
    }
}

/// Parses the rig.toml at `path` (or in it) without checking its values; also returns the rig's folder.
pub(in crate::rig) fn read_toml(path: &Path) -> Result<(PathBuf, RigToml), RigError> {
    let root = match path.file_name() {
        Some(name) if name == RIG_FILE && !path.is_dir() => match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_path_buf(),
            _ => PathBuf::from("."),
        },
        _ => path.to_path_buf(),
    };
    let file = root.join(RIG_FILE);
    if !file.is_file() {
        return Err(RigError::NotARig { path: path.to_path_buf() });
    }
    let bytes = read_file(&file, MAX_TEXT).map_err(|source| RigError::Io { path: file.clone(), source })?;
    let toml = parse(&file, bytes)?;
    Ok((root, toml))
}

/// Parses the content of the rig.toml `file` without checking its values.
pub(in crate::rig) fn parse(file: &Path, bytes: Vec<u8>) -> Result<RigToml, RigError> {
    let syntax = |reason| RigError::Syntax { path: file.to_path_buf(), reason };
    let text = String::from_utf8(bytes).map_err(|e| syntax(format!("it is no text ({})", e.utf8_error())))?;
    // The version comes first: a newer layout may well have keys that are unknown here.
    let table: toml::Table = toml::from_str(&text).map_err(|e| syntax(toml_reason(&e, &text)))?;
    if let Some(found) = table.get("format").and_then(toml::Value::as_integer).filter(|&f| f > FORMAT) {
        return Err(RigError::NewerFormat { path: file.to_path_buf(), found, known: FORMAT });
    }
    toml::from_str(&text).map_err(|e| syntax(toml_reason(&e, &text)))
}
