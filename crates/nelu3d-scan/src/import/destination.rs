//! The rig that a recording goes to: one that is there, or a new one.

use std::path::{Path, PathBuf};

use super::frame::{Format, Frame};
use super::order::{self, Slots};
use super::{ImportError, ImportRequest};
use crate::camera::{Camera, read_camera};
use crate::image::Channels;
use crate::rig::{RIG_FILE, Rig};

/// The rig as it is before the import.
pub(super) enum Destination {
    Old(Box<Rig>),
    New { root: PathBuf, camera: Box<Camera> },
}

/// The rig as it will be but for its levels, and the order of the frames.
pub(super) struct Plan {
    pub rig: Rig,
    pub slots: Slots,
}

impl Destination {
    pub(super) fn of(request: &ImportRequest) -> Result<Self, ImportError> {
        let path = &request.rig;
        let is_file = path.file_name().is_some_and(|n| n == RIG_FILE) && !path.is_dir();
        if is_file || path.join(RIG_FILE).is_file() {
            let rig = Rig::open(path)?;
            let given = [
                ("--camera", request.camera.is_some()),
                ("--channels", request.channels.is_some()),
                ("--black-level", request.black_level.is_some()),
                ("--saturation", request.saturation.is_some()),
            ];
            if let Some((option, _)) = given.iter().find(|(_, given)| *given) {
                let problem = format!("exists and says this itself, so {option} is for new rigs only");
                let remedy = "leave it away, or correct rig.toml";
                return Err(ImportError::unfit(rig.root.join(RIG_FILE), problem, remedy));
            }
            return Ok(Self::Old(Box::new(rig)));
        }
        let own = path.join("camera.json");
        let file = match &request.camera {
            Some(file) if own.exists() && own.canonicalize().ok() != file.canonicalize().ok() => {
                let remedy = "leave --camera away, or remove this file";
                return Err(ImportError::unfit(own, "exists, and --camera is another file", remedy));
            }
            Some(file) => file,
            None if own.exists() => &own,
            None => {
                let problem = "is no rig yet, and a new one needs the camera's intrinsics";
                return Err(ImportError::unfit(path, problem, "give them with --camera camera.json"));
            }
        };
        Ok(Self::New { root: path.clone(), camera: Box::new(read_camera(file)?) })
    }

    pub(super) fn camera(&self) -> &Camera {
        match self {
            Self::Old(rig) => &rig.camera,
            Self::New { camera, .. } => camera,
        }
    }

    pub(super) fn plan(&self, request: &ImportRequest, first: &Frame) -> Result<Plan, ImportError> {
        let (words, set) = (request.order.as_deref(), request.set.as_deref());
        match self {
            Self::Old(rig) => Ok(Plan { slots: order::of_rig(words, rig, set)?, rig: (**rig).clone() }),
            Self::New { root, camera } => {
                let ending = match first.format {
                    Format::Tiff => "tiff",
                    Format::Png | Format::Dng => "png",
                };
                let (slots, set) = order::of_new(words, root, ending, set)?;
                let named = |stem: &str| {
                    let is = |n: &&String| Path::new(n).file_stem().is_some_and(|s| s == stem);
                    slots.iter().flatten().find(is).cloned().unwrap_or_else(|| format!("{stem}.{ending}"))
                };
                let rig = Rig {
                    root: root.clone(),
                    name: root.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                    camera: (**camera).clone(),
                    camera_file: "camera.json".into(),
                    channels: channels_of(request, first)?,
                    response: None,
                    black_level: 0.0,
                    saturation: 1.0,
                    white: named("white"),
                    black: named("black"),
                    pattern_sets: vec![set],
                    board: None,
                    poses: Vec::new(),
                    projector: None,
                    memory: None,
                };
                Ok(Plan { rig, slots })
            }
        }
    }
}

/// Returns how the sensor of a new rig delivers color.
fn channels_of(request: &ImportRequest, first: &Frame) -> Result<Channels, ImportError> {
    match request.channels.or(first.facts.channels) {
        Some(channels) => Ok(channels),
        None if first.raw.channels == 3 => Ok(Channels::Rgb),
        None => Err(ImportError::unfit(
            &first.path,
            "has one channel, and does not say whether that is gray or the mosaic of a color sensor",
            "give --channels mono, or the mosaic's layout as --channels bayer-grbg",
        )),
    }
}
