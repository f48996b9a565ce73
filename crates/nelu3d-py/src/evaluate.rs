//! `evaluate`: a result against ground truth, another result, or a CAD model.

use std::path::PathBuf;

use nelu3d::result::SavedResult;
use nelu3d_evaluate::cad::{CadOptions, InitialPose, ScanMaps, compare_with_cad};
use nelu3d_evaluate::{EvaluatedMaps, GroundTruth, compare};
use nelu3d_scan::{Camera, Mesh, Projector};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use crate::error::{Error, exception};
use crate::result::Reconstruction;
use crate::{json, work};

/// What is evaluated: a result, with the projector in whose columns errors are measured, too.
struct Evaluated {
    camera: Camera,
    depth: Vec<f32>,
    normals: Option<Vec<[f32; 3]>>,
    sigma: Option<Vec<f32>>,
    projector: Option<Projector>,
}

impl Evaluated {
    /// Takes a reconstruction, or reads a result folder.
    fn new(result: &Bound<'_, PyAny>) -> PyResult<Self> {
        if let Ok(result) = result.cast::<Reconstruction>() {
            let Reconstruction { surface, rig, .. } = result.get();
            return Ok(Self {
                camera: rig.camera.clone(),
                depth: surface.depth.clone(),
                normals: Some(surface.normals.clone()),
                sigma: Some(surface.sigma.clone()),
                projector: rig.projector.clone(),
            });
        }
        let path: PathBuf = result
            .extract()
            .map_err(|_| Error::new_err("give a nelu3d.Reconstruction, or the path of a result folder"))?;
        let SavedResult { camera, depth, normals, sigma } = SavedResult::read(&path).map_err(exception)?;
        Ok(Self { camera, depth, normals, sigma, projector: None })
    }
}

/// Reads a ground truth's folder, or takes an array of depths, mm, with NaN where there is no surface.
fn ground_truth(truth: &Bound<'_, PyAny>, camera: &Camera) -> PyResult<GroundTruth> {
    if let Ok(path) = truth.extract::<PathBuf>() {
        return GroundTruth::read(&path, camera).map_err(exception);
    }
    let array = truth.py().import("numpy")?.call_method1("asarray", (truth, "float32"))?;
    let wrong = || Error::new_err("truth: give the path of a folder, or an array of depths, height × width, mm");
    let array: PyReadonlyArray2<'_, f32> = array.extract().map_err(|_| wrong())?;
    let depth = array.as_array();
    let (width, height) = (camera.width, camera.height);
    if depth.dim() != (height, width) {
        let problem = format!("truth: has the shape {:?}, but the result ({height}, {width})", depth.dim());
        return Err(Error::new_err(problem + "; give a depth for each of its pixels"));
    }
    let depth: Vec<f32> = depth.iter().copied().collect();
    Ok(GroundTruth { width, height, mask: depth.iter().map(|z| z.is_finite()).collect(), depth })
}

/// Evaluates a result (a `Reconstruction`, or the path of a result folder) against `truth` (the path of a folder with
/// depth.npy and mask.png, or an array of depths in mm), `against` another result, or against a `cad` model (the path
/// of a mesh in mm). Returns the numbers that `nelu3d evaluate --json` has: mm, degrees, fractions.
#[pyfunction]
#[pyo3(signature = (result, truth = None, *, against = None, cad = None, progress = None))]
pub(crate) fn evaluate<'py>(
    py: Python<'py>,
    result: &Bound<'py, PyAny>,
    truth: Option<&Bound<'py, PyAny>>,
    against: Option<&Bound<'py, PyAny>>,
    cad: Option<PathBuf>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let r = Evaluated::new(result)?;
    let callback = progress.as_ref();
    match (truth, against, cad) {
        (Some(truth), None, None) => {
            let truth = ground_truth(truth, &r.camera)?;
            let metrics = work::run(py, callback, |_| {
                let maps = EvaluatedMaps { depth: &r.depth, normals: r.normals.as_deref(), sigma: r.sigma.as_deref() };
                let regions = truth.regions(&r.camera);
                Ok(nelu3d_evaluate::evaluate(&maps, &truth, &regions, &r.camera, r.projector.as_ref()))
            })?;
            json::to_python(py, &metrics)
        }
        (None, Some(other), None) => {
            let other = Evaluated::new(other)?;
            if (other.camera.width, other.camera.height) != (r.camera.width, r.camera.height) {
                return Err(Error::new_err("against: has another number of pixels; give a result of the same camera"));
            }
            json::to_python(py, &compare(&r.depth, &other.depth))
        }
        (None, None, Some(path)) => {
            let mesh = Mesh::read(&path).map_err(exception)?;
            let found = work::run(py, callback, |progress| {
                let options = CadOptions { start: InitialPose::Search, ..CadOptions::default() };
                let scan = ScanMaps { camera: &r.camera, depth: &r.depth, normals: r.normals.as_deref() };
                Ok(compare_with_cad(&scan, &mesh, &options, progress)?)
            })?;
            json::to_python(py, &found.metrics)
        }
        _ => Err(Error::new_err("give one of truth, against, and cad")),
    }
}
