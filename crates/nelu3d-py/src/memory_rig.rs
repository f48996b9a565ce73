//! A rig made of arrays.

use std::path::{Path, PathBuf};

use nelu3d_scan::camera::{camera_from_bytes, read_camera};
use nelu3d_scan::rig::{MemoryImages, StoredImage};
use nelu3d_scan::{Camera, Rig};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyMapping, PyString};
use serde_json::{Value, json};

use crate::arrays::ArrayImage;
use crate::error::{Error, exception};
use crate::json::from_python;

/// The arrays of a rig, by the names of folders and files that it would have.
pub(crate) struct ArraysOfRig<'py> {
    /// Position → image → array; a list stands for positions 000, 001, …
    pub(crate) calibration: Option<Bound<'py, PyAny>>,
    /// Scene → image → array.
    pub(crate) scenes: Option<Bound<'py, PyAny>>,
    /// Sequence → frame → image → array; a list stands for frames 000, 001, …
    pub(crate) sequences: Option<Bound<'py, PyAny>>,
}

/// What rig.toml says of a rig on disk.
pub(crate) struct Settings<'a, 'py> {
    /// Table `[board]`.
    pub(crate) board: Option<Bound<'py, PyAny>>,
    /// Position → (rotation vector in radians, translation in mm).
    pub(crate) poses: Option<Bound<'py, PyAny>>,
    /// Color format; found from the arrays if it is not given.
    pub(crate) channels: Option<&'a str>,
    /// Code of no light.
    pub(crate) black_level: f64,
    /// Code that is clipped; the largest of the arrays' type if it is not given.
    pub(crate) saturation: Option<f64>,
    /// How codes follow light.
    pub(crate) response: Option<&'a str>,
    /// Name of the flash.
    pub(crate) white: &'a str,
    /// Name of the ambient image.
    pub(crate) black: &'a str,
    /// Name of the rig, which messages begin with.
    pub(crate) name: &'a str,
}

/// Makes the rig.
///
/// # Errors
///
/// An argument cannot be used; the message says which, and how it should be.
pub(crate) fn memory_rig(
    camera: &Bound<'_, PyAny>,
    patterns: &Bound<'_, PyAny>,
    arrays: &ArraysOfRig<'_>,
    settings: &Settings<'_, '_>,
) -> PyResult<Rig> {
    let root = Path::new(settings.name);
    let mut images = Vec::new();
    if let Some(all) = &arrays.calibration {
        shots(&root.join("calibration"), all, &mut images)?;
    }
    if let Some(all) = &arrays.scenes {
        shots(&root.join("scenes"), all, &mut images)?;
    }
    if let Some(all) = &arrays.sequences {
        for (name, frames) in entries(&root.join("sequences"), all)? {
            shots(&root.join("sequences").join(name), &frames, &mut images)?;
        }
    }
    let Some((_, first)) = images.first() else {
        return Err(Error::new_err("there are no images; give some as calibration, scenes, or sequences"));
    };
    let described = description(patterns, settings, first)?;
    let camera = self::camera(root, camera, first.size())?;
    let mut rig = Rig::from_bytes(root, described.into_bytes(), camera, None).map_err(exception)?;
    let images = images.into_iter().map(|(path, image)| (path, Box::new(image) as Box<dyn StoredImage>));
    rig.memory = Some(MemoryImages::new(images));
    Ok(rig)
}

/// Returns what rig.toml would say.
fn description(patterns: &Bound<'_, PyAny>, settings: &Settings<'_, '_>, first: &ArrayImage) -> PyResult<String> {
    let channels = settings.channels.unwrap_or(if first.channels() == 3 { "rgb" } else { "mono" });
    let sets = match from_python(patterns)? {
        Value::Object(sets) => {
            sets.into_iter().map(|(name, images)| json!({ "name": name, "images": images })).collect()
        }
        images => vec![json!({ "name": "patterns", "images": images })],
    };
    let mut rig = json!({
        "format": 1,
        "name": settings.name,
        "camera": {
            "channels": channels,
            "black_level": settings.black_level,
            "saturation": settings.saturation.unwrap_or(first.full_scale()),
        },
        "images": { "white": settings.white, "black": settings.black },
        "pattern_sets": sets,
    });
    if let Some(response) = settings.response {
        rig["camera"]["response"] = response.into();
    }
    if let Some(board) = &settings.board {
        rig["board"] = from_python(board)?;
    }
    if let Some(poses) = &settings.poses {
        let Value::Object(poses) = from_python(poses)? else {
            return Err(Error::new_err("poses: give a dictionary, position → (rotation vector, translation in mm)"));
        };
        let pose = |(name, pose): (String, Value)| {
            let [rotation, translation] = [0, 1].map(|i| flat(pose.get(i).cloned().unwrap_or_default()));
            json!({ "position": name, "rotation": rotation, "translation": translation })
        };
        rig["poses"] = poses.into_iter().map(pose).collect();
    }
    toml::to_string(&rig).map_err(|e| Error::new_err(format!("the rig's description: {e}; leave out what is None")))
}

/// Returns the numbers of a nested list: OpenCV's vectors are columns.
fn flat(numbers: Value) -> Value {
    match numbers {
        Value::Array(parts) => {
            parts.into_iter().flat_map(|p| if let Value::Array(p) = flat(p.clone()) { p } else { vec![p] }).collect()
        }
        number => number,
    }
}

/// Returns the camera of a file, of a camera matrix K, or of a dictionary as camera.json has it, whose size may be left
/// to the images.
fn camera(root: &Path, camera: &Bound<'_, PyAny>, (width, height): (usize, usize)) -> PyResult<Camera> {
    if let Ok(path) = camera.extract::<PathBuf>() {
        return read_camera(&path).map_err(exception);
    }
    let mut described = match from_python(camera)? {
        Value::Object(keys) => keys,
        matrix => serde_json::Map::from_iter([("K".into(), matrix)]),
    };
    described.entry("resx").or_insert(width.into());
    described.entry("resy").or_insert(height.into());
    let distortion = described.remove("dist_coeffs").unwrap_or_else(|| json!([]));
    described.insert("dist_coeffs".into(), flat(distortion));
    camera_from_bytes(&root.join("camera"), Value::Object(described).to_string().as_bytes()).map_err(exception)
}

/// Adds the images of all shots in a folder.
fn shots(dir: &Path, all: &Bound<'_, PyAny>, images: &mut Vec<(PathBuf, ArrayImage)>) -> PyResult<()> {
    for (name, shot) in entries(dir, all)? {
        let dir = dir.join(name);
        for (name, image) in entries(&dir, &shot)? {
            let path = dir.join(name);
            let image = ArrayImage::new(&path, &image)?;
            images.push((path, image));
        }
    }
    Ok(())
}

/// Returns the entries of a dictionary with their names; those of a list are named 000, 001, …
fn entries<'py>(dir: &Path, all: &Bound<'py, PyAny>) -> PyResult<Vec<(String, Bound<'py, PyAny>)>> {
    if let Ok(list) = all.cast::<PyList>() {
        return Ok(list.iter().enumerate().map(|(i, entry)| (format!("{i:03}"), entry)).collect());
    }
    let wrong = || Error::new_err(format!("{}: is no dictionary of names; give one, name → content", dir.display()));
    let keys = match all.cast::<PyDict>() {
        Ok(dict) => dict.items(),
        Err(_) => all.cast::<PyMapping>().map_err(|_| wrong())?.items()?,
    };
    keys.iter()
        .map(|pair| {
            let (name, entry): (Bound<'py, PyAny>, Bound<'py, PyAny>) = pair.extract()?;
            let name: String = name.cast::<PyString>().map_err(|_| wrong())?.extract()?;
            // Below this name lie others: it must not lead elsewhere.
            let plain = !name.is_empty() && !name.starts_with('.') && !name.contains(['/', '\\']);
            let bad =
                || Error::new_err(format!("{}: {name:?} is no name; use letters, digits, - and _", dir.display()));
            if plain { Ok((name, entry)) } else { Err(bad()) }
        })
        .collect()
}
