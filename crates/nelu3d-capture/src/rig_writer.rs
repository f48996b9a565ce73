//! The rig folder that a capture fills: each position and each scene is whole or absent.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use nelu3d_scan::Camera as Intrinsics;
use nelu3d_scan::camera::{read_camera, write_camera};
use nelu3d_scan::image::{Channels, Raw, RawData, Response, write_raw_png};
use nelu3d_scan::input::{MAX_TEXT, read_file, read_text};
use nelu3d_scan::output::{OutputDir, create_dir, link_or_copy, remove_abandoned, write_atomic};
use nelu3d_scan::rig::{RIG_FILE, Rig, state_response};

use crate::error::CaptureError;
use crate::session::SlideImages;

/// What a rig says that does not exist yet.
#[derive(Clone, Debug)]
pub struct NewRig {
    /// Free text.
    pub name: String,
    /// How the sensor delivers color.
    pub channels: Channels,
    /// Sensor code for no light.
    pub black_level: f64,
    /// Sensor code at and above which a value is clipped.
    pub saturation: f64,
    /// How its codes follow light, as rig.toml names it: `linear` or `srgb`.
    pub response: Option<String>,
    /// Intrinsics of the camera, if they are known already.
    pub intrinsics: Option<Intrinsics>,
    /// A TOML file with the table `[board]`, as in rig.toml.
    pub board: Option<PathBuf>,
    /// A folder that `nelu3d patterns` wrote.
    pub patterns: PathBuf,
}

/// Where images go to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ShotPlace {
    /// A board position of the sweep.
    Position(String),
    /// A scene.
    Scene(String),
}

impl ShotPlace {
    fn folder(&self) -> PathBuf {
        match self {
            Self::Position(name) => Path::new("calibration").join(name),
            Self::Scene(name) => Path::new("scenes").join(name),
        }
    }
}

/// A rig folder that is being filled.
#[derive(Debug)]
pub struct RigWriter {
    rig: Rig,
    /// Names of the files of a folder after white and black: patterns, then inverses.
    names: Vec<String>,
    /// Whether the intrinsics are there.
    has_intrinsics: bool,
}

/// The name that the intrinsics have in a new rig.
const CAMERA_FILE: &str = "camera.json";

impl RigWriter {
    /// Opens a rig to add to it. What an earlier capture that was killed had under construction is removed. The
    /// intrinsics may be missing yet.
    ///
    /// # Errors
    ///
    /// There is no rig, or it is not sound.
    pub fn open(root: &Path) -> Result<Self, CaptureError> {
        let file = root.join(RIG_FILE);
        let bytes = read_file(&file, MAX_TEXT).map_err(|e| unfit(&file, e, "give the folder of a rig"))?;
        let table: toml::Table = String::from_utf8_lossy(&bytes).parse().unwrap_or_default();
        let name = table.get("camera").and_then(|c| c.get("intrinsics")).and_then(toml::Value::as_str);
        let camera_file = root.join(name.unwrap_or(CAMERA_FILE));
        let camera = camera_file.exists().then(|| read_camera(&camera_file)).transpose();
        let camera = camera.map_err(nelu3d_scan::rig::RigError::from)?;
        let has_intrinsics = camera.is_some();
        // Of the intrinsics nothing is used here; a rig has some, though.
        let camera = camera.unwrap_or_else(|| Intrinsics::pinhole(1, 1, 1.0, 1.0, 0.0, 0.0));
        let rig = Rig::from_bytes(root, bytes, camera, None)?;
        Self::of(rig, has_intrinsics)
    }

    /// Makes a new rig: its rig.toml, its intrinsics if they are known, and the patterns.
    ///
    /// # Errors
    ///
    /// There is a rig already, a file is missing or not sound, or the folder cannot be written to.
    pub fn create(root: &Path, new: &NewRig) -> Result<Self, CaptureError> {
        let file = root.join(RIG_FILE);
        if file.exists() {
            return Err(unfit(&file, "there is a rig already", "go on with it, or choose another folder"));
        }
        let set = pattern_set(&new.patterns)?;
        let mut camera = toml::Table::new();
        camera.insert("channels".into(), new.channels.name().into());
        camera.insert("black_level".into(), new.black_level.into());
        camera.insert("saturation".into(), new.saturation.into());
        if let Some(response) = &new.response {
            camera.insert("response".into(), response.as_str().into());
        }
        let mut table = toml::Table::new();
        table.insert("format".into(), 1.into());
        table.insert("name".into(), new.name.as_str().into());
        table.insert("camera".into(), camera.into());
        table.insert("pattern_sets".into(), vec![toml::Value::Table(set)].into());
        if let Some(path) = &new.board {
            let remedy = "give a file with the lines that `nelu3d board` prints, beginning with [board]";
            let text = read_text(path).map_err(|e| unfit(path, e, remedy))?;
            let read: toml::Table = text.parse().map_err(|e: toml::de::Error| unfit(path, e.message(), remedy))?;
            let board = read.get("board").ok_or_else(|| unfit(path, "has no table [board]", remedy))?;
            table.insert("board".into(), board.clone());
        }
        let text = toml::to_string(&table).map_err(|e| unfit(&file, e, "report this"))?;
        let placeholder = Intrinsics::pinhole(1, 1, 1.0, 1.0, 0.0, 0.0);
        let rig = Rig::from_bytes(root, text.clone().into_bytes(), placeholder, None)?;
        let writer = Self::of(rig, new.intrinsics.is_some())?;
        create_dir(root)?;
        writer.keep_patterns(&new.patterns)?;
        if let Some(intrinsics) = &new.intrinsics {
            write_camera(&root.join(CAMERA_FILE), intrinsics)?;
        }
        // Last: what has a rig.toml is a rig.
        write_atomic(&file, |w| w.write_all(text.as_bytes()))?;
        Ok(writer)
    }

    /// Makes a new rig that is described as another one is.
    ///
    /// # Errors
    ///
    /// The folder cannot be written to.
    pub fn create_like(root: &Path, other: &Rig) -> Result<Self, CaptureError> {
        let rig = Rig { root: root.to_path_buf(), ..other.clone() };
        rig.save()?;
        Self::of(rig, true)
    }

    fn of(rig: Rig, has_intrinsics: bool) -> Result<Self, CaptureError> {
        let mut seen: HashSet<&str> = [rig.white.as_str(), rig.black.as_str()].into();
        let all = rig.pattern_sets.iter().flat_map(|s| s.images.iter().chain(&s.inverse));
        let names: Vec<String> = all.filter(|name| seen.insert(name.as_str())).cloned().collect();
        let file = rig.root.join(RIG_FILE);
        for name in [&rig.white, &rig.black].into_iter().chain(&names) {
            if !name.ends_with(".png") {
                let problem = format!("calls an image {name}, and captures are PNG files");
                return Err(unfit(&file, problem, "call it .png, or use `nelu3d import`"));
            }
        }
        if names.is_empty() {
            return Err(unfit(&file, "has no pattern set", "add a [[pattern_sets]] with name and images"));
        }
        for folder in ["calibration", "scenes"] {
            // What a killed capture had under construction.
            remove_abandoned(&rig.root.join(folder));
        }
        Ok(Self { rig, names, has_intrinsics })
    }

    /// Returns the rig. Its intrinsics mean nothing if [`RigWriter::has_intrinsics`] denies that there are any.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Returns whether the rig's intrinsics are known.
    pub fn has_intrinsics(&self) -> bool {
        self.has_intrinsics
    }

    /// Returns the names of the images to show after white and black, and to pass to [`RigWriter::write`] in this
    /// order.
    pub fn pattern_names(&self) -> &[String] {
        &self.names
    }

    /// Returns the first free name of a board position: the next number.
    ///
    /// # Errors
    ///
    /// The folder cannot be read.
    pub fn next_position(&self) -> Result<ShotPlace, CaptureError> {
        let dir = self.rig.root.join("calibration");
        let taken = (0..).find(|i| !dir.join(format!("{i:03}")).exists());
        let number = taken.ok_or_else(|| unfit(&dir, "is full", "begin another rig"))?;
        Ok(ShotPlace::Position(format!("{number:03}")))
    }

    /// Returns how many board positions there are.
    pub fn positions(&self) -> usize {
        self.rig.positions().map_or(0, |p| p.len())
    }

    /// Returns the folder of a place, whether it is there or not.
    pub fn folder(&self, place: &ShotPlace) -> PathBuf {
        self.rig.root.join(place.folder())
    }

    /// Writes the images of a folder, which appears whole or not at all.
    ///
    /// # Errors
    ///
    /// The folder exists, its name is none, the frames do not fit to rig.toml, or the disk refuses.
    pub fn write(&self, place: &ShotPlace, images: &SlideImages) -> Result<PathBuf, CaptureError> {
        assert_eq!(images.patterns.len(), self.names.len(), "one image per name");
        let (ShotPlace::Position(name) | ShotPlace::Scene(name)) = place;
        let target = self.folder(place);
        if name.is_empty() || name.starts_with('.') || name.contains(['/', '\\', ':']) {
            return Err(unfit(&target, "is not the name of a folder of a rig", "use letters, digits, - and _"));
        }
        if target.exists() {
            return Err(unfit(&target, "exists", "choose another name, or remove it"));
        }
        self.check(&images.white.raw)?;
        let folder = OutputDir::create(&target, &self.rig.white)?;
        let patterns = self.names.iter().zip(&images.patterns);
        let flashes = [(&self.rig.white, &images.white), (&self.rig.black, &images.black)];
        for (name, frame) in flashes.into_iter().chain(patterns) {
            write_raw_png(&folder.path().join(name), &frame.raw)?;
        }
        folder.commit()?;
        Ok(target)
    }

    /// Writes images whose light adds up, under their `names`, into the folder `folder` of the rig, which appears whole or
    /// not at all.
    ///
    /// # Errors
    ///
    /// The frames do not fit to rig.toml, or the disk refuses.
    pub fn write_aside(&self, folder: &str, names: &[String], images: &SlideImages) -> Result<PathBuf, CaptureError> {
        assert_eq!(images.patterns.len(), names.len(), "one image per name");
        self.check(&images.white.raw)?;
        let target = self.rig.root.join(folder);
        let made = OutputDir::create(&target, "black.png")?;
        let flashes = [("white.png", &images.white), ("black.png", &images.black)];
        for (name, frame) in flashes.into_iter().chain(names.iter().map(String::as_str).zip(&images.patterns)) {
            write_raw_png(&made.path().join(name), &frame.raw)?;
        }
        made.commit()?;
        Ok(target)
    }

    /// States in the rig how its camera's codes follow light.
    ///
    /// # Errors
    ///
    /// As [`state_response`].
    pub fn set_response(&mut self, response: Response) -> Result<(), CaptureError> {
        state_response(&self.rig.root, &response)?;
        self.rig.response = Some(response);
        Ok(())
    }

    /// Complains about frames that the rig's description does not fit.
    fn check(&self, raw: &Raw) -> Result<(), CaptureError> {
        let (rig, file) = (&self.rig, self.rig.root.join(RIG_FILE));
        let remedy = "correct rig.toml, or use the camera that it describes";
        if raw.channels != rig.channels.in_file() {
            let problem = format!("says channels = \"{}\", but frames have {}", rig.channels.name(), raw.channels);
            return Err(unfit(&file, problem, remedy));
        }
        if let Some(max) = raw.depth().max().filter(|max| rig.saturation > *max) {
            let problem = format!("says saturation = {}, but frames end at {max}", rig.saturation);
            return Err(unfit(&file, problem, remedy));
        }
        if matches!(raw.data, RawData::Float(_)) {
            return Err(unfit(&file, "cannot take frames of floating-point numbers", "use `nelu3d import`"));
        }
        if self.has_intrinsics && (rig.camera.width, rig.camera.height) != (raw.width, raw.height) {
            let (w, h) = (rig.camera.width, rig.camera.height);
            let problem = format!("is of {w} x {h} px, but frames have {} x {}", raw.width, raw.height);
            return Err(unfit(&rig.root.join(&rig.camera_file), problem, remedy));
        }
        Ok(())
    }

    /// Keeps the patterns of the folder `from` in the rig, under the names of their captures.
    ///
    /// # Errors
    ///
    /// One is missing, or the rig cannot be written to.
    pub fn keep_patterns(&self, from: &Path) -> Result<(), CaptureError> {
        let to = self.rig.root.join("patterns");
        create_dir(&to)?;
        for name in self.names.iter().chain([&self.rig.white, &self.rig.black]) {
            let (from, to) = (from.join(name), to.join(name));
            if !from.exists() {
                return Err(unfit(&from, "is missing", "write the patterns again with `nelu3d patterns`"));
            }
            if !to.exists() {
                link_or_copy(&from, &to)?;
            }
        }
        Ok(())
    }
}

/// Reads the pattern set of a folder that `nelu3d patterns` wrote.
fn pattern_set(folder: &Path) -> Result<toml::Table, CaptureError> {
    let file = folder.join("patterns.json");
    let remedy = "write the patterns with `nelu3d patterns recommended`";
    let text = read_text(&file).map_err(|e| unfit(&file, e, remedy))?;
    let json: serde_json::Value = serde_json::from_str(&text).map_err(|e| unfit(&file, e, remedy))?;
    let set: Option<toml::Table> = json.get("pattern_set").cloned().and_then(|set| serde_json::from_value(set).ok());
    set.ok_or_else(|| unfit(&file, "has no pattern_set", remedy))
}

fn unfit(path: &Path, problem: impl std::fmt::Display, remedy: &str) -> CaptureError {
    CaptureError::Unfit { path: path.to_path_buf(), problem: problem.to_string(), remedy: remedy.into() }
}
