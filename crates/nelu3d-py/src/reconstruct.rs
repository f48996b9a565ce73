//! `reconstruct` and `decode`.

use std::path::PathBuf;
use std::sync::Arc;

use nelu3d::ReconstructionOptions;
use nelu3d::sensor::judge_capture;
use nelu3d::verdict::Judgment;
use nelu3d_baselines::{DecodeOptions, Method};
use nelu3d_scan::rig::Need;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{Error, exception};
use crate::field::ColorField;
use crate::result::Reconstruction;
use crate::rig::Rig;
use crate::{json, work};

/// Returns a field: one that was given, that of a file, or the one that the program has written for the rig.
pub(crate) fn field_of(
    rig: &Rig,
    set: &str,
    field: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Arc<nelu3d::ColorField>, Option<PathBuf>)> {
    if let Some(Ok(field)) = field.map(|f| f.cast::<ColorField>()) {
        return Ok((field.get().field.clone(), field.get().file.clone()));
    }
    let path = match field {
        Some(path) => {
            path.extract().map_err(|_| Error::new_err("field: give a nelu3d.ColorField, or the path of one"))?
        }
        None => rig.default_field(set)?,
    };
    if !path.exists() {
        let path = path.display();
        return Err(Error::new_err(format!(
            "{path}: there is no color field; make one with nelu3d.calibrate, or give one"
        )));
    }
    let read = ColorField::read(path)?;
    Ok((read.field, read.file))
}

/// Reconstructs a scene: the same surface as `nelu3d reconstruct` writes. Settings are those of the program with
/// underscores; those of recipe `paper` are a dictionary `paper`.
#[pyfunction]
#[pyo3(signature = (
    rig, scene, field = None, *, set = None, accept = false, device = "auto", progress = None, **settings
))]
pub(crate) fn reconstruct(
    py: Python<'_>,
    rig: &Bound<'_, Rig>,
    scene: &str,
    field: Option<&Bound<'_, PyAny>>,
    set: Option<&str>,
    accept: bool,
    device: &str,
    progress: Option<Bound<'_, PyAny>>,
    settings: Option<&Bound<'_, PyDict>>,
) -> PyResult<Py<Reconstruction>> {
    let (rig, set) = (rig.get(), rig.get().set(set)?);
    let shot = rig.rig.scene(scene).map_err(exception)?;
    let mut options: ReconstructionOptions = json::settings(&ReconstructionOptions::default(), settings)?;
    options.device = work::device(device)?;
    let (field, file) = field_of(rig, &set.name, field)?;
    let made = work::run(py, progress.as_ref(), |progress| {
        Ok(nelu3d::reconstruct(&rig.rig, &set, &shot, &field, &options, progress)?)
    })?;
    let result = Reconstruction {
        surface: made.surface,
        judgment: made.diagnostics.judgment.clone(),
        diagnostics: serde_json::to_value(&made.diagnostics).map_err(exception)?,
        stages: made.stages,
        rig: rig.rig.clone(),
        set,
        shot,
        files: file.into_iter().collect(),
    };
    result.hand_out(py, accept)
}

/// Decodes a scene by a baseline, "gray", "phase", "mps", "zncc", "turbosl", "lookup3d", or "lookup3d-lowrank": the
/// same surface as `nelu3d decode` writes.
#[pyfunction]
#[pyo3(signature = (rig, scene, method, *, set = None, accept = false, progress = None, **settings))]
pub(crate) fn decode(
    py: Python<'_>,
    rig: &Bound<'_, Rig>,
    scene: &str,
    method: &str,
    set: Option<&str>,
    accept: bool,
    progress: Option<Bound<'_, PyAny>>,
    settings: Option<&Bound<'_, PyDict>>,
) -> PyResult<Py<Reconstruction>> {
    let (rig, set) = (rig.get(), rig.get().set(set)?);
    let shot = rig.rig.scene(scene).map_err(exception)?;
    let method: Method =
        serde_json::from_value(method.into()).map_err(|e| Error::new_err(format!("method: {e}; give one of these")))?;
    let options: DecodeOptions = json::settings(&DecodeOptions::new(method), settings)?;
    let (made, judgment) = work::run(py, progress.as_ref(), |progress| {
        let made = nelu3d_baselines::decode(&rig.rig, &set, &shot, &options, progress)?;
        // A baseline is judged by its captures alone, as the program does.
        let capture = rig.rig.read_shot(&shot, &set, Need::Scene)?;
        let mut judgment = Judgment::default();
        judgment.extend(judge_capture(&capture, &made.surface.status, &set.images));
        Ok((made, judgment))
    })?;
    let result = Reconstruction {
        surface: made.surface,
        judgment,
        diagnostics: serde_json::to_value(&made.diagnostics).map_err(exception)?,
        stages: made.stages,
        rig: rig.rig.clone(),
        set,
        shot,
        files: Vec::new(),
    };
    result.hand_out(py, accept)
}
