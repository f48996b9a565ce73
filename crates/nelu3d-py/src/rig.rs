//! `Rig`: a folder, or arrays in its place.

use std::path::PathBuf;
use std::sync::Arc;

use nelu3d::result::CameraJson;
use nelu3d_scan::rig::{Need, PatternSet, Shot, check};
use numpy::PyArrayDyn;
use numpy::ndarray::Array;
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{Error, Problem, exception};
use crate::memory_rig::{ArraysOfRig, memory_rig};
use crate::{json, work};

/// A camera and a light source that did not move: a folder on the disk, or arrays.
#[pyclass(frozen, module = "nelu3d", name = "Rig")]
pub(crate) struct Rig {
    /// The rig.
    pub(crate) rig: Arc<nelu3d_scan::Rig>,
}

impl Rig {
    /// Returns the pattern set of a name, or the first one.
    pub(crate) fn set(&self, name: Option<&str>) -> PyResult<PatternSet> {
        self.rig.pattern_set(name).cloned().map_err(exception)
    }

    /// Returns where the program has the color field of a set.
    ///
    /// # Errors
    ///
    /// The rig is made of arrays, and has no folder.
    pub(crate) fn default_field(&self, set: &str) -> PyResult<PathBuf> {
        if self.rig.memory.is_some() {
            return Err(Error::new_err(
                "a rig of arrays has no folder to look for a color field in; give one as `field`",
            ));
        }
        Ok(self.rig.root.join("fields").join(format!("{set}.safetensors")))
    }
}

#[pymethods]
impl Rig {
    /// Opens a rig folder, or its rig.toml. No image is read yet.
    #[staticmethod]
    fn open(path: PathBuf) -> PyResult<Self> {
        Ok(Self { rig: Arc::new(nelu3d_scan::Rig::open(&path).map_err(exception)?) })
    }

    /// Makes a rig of arrays: height × width (× 3) codes of type uint8, uint16, or float32. They are not copied; do not
    /// write to them while work goes on.
    #[staticmethod]
    #[pyo3(signature = (
        *, camera, patterns, calibration = None, scenes = None, sequences = None, board = None, poses = None,
        channels = None, black_level = 0.0, saturation = None, response = None, white = "white", black = "black",
        name = "arrays"
    ))]
    fn from_arrays(
        camera: &Bound<'_, PyAny>,
        patterns: &Bound<'_, PyAny>,
        calibration: Option<Bound<'_, PyAny>>,
        scenes: Option<Bound<'_, PyAny>>,
        sequences: Option<Bound<'_, PyAny>>,
        board: Option<Bound<'_, PyAny>>,
        poses: Option<Bound<'_, PyAny>>,
        channels: Option<&str>,
        black_level: f64,
        saturation: Option<f64>,
        response: Option<&str>,
        white: &str,
        black: &str,
        name: &str,
    ) -> PyResult<Self> {
        let arrays = ArraysOfRig { calibration, scenes, sequences };
        let settings = crate::memory_rig::Settings {
            board,
            poses,
            channels,
            black_level,
            saturation,
            response,
            white,
            black,
            name,
        };
        Ok(Self { rig: Arc::new(memory_rig(camera, patterns, &arrays, &settings)?) })
    }

    /// Folder of the rig; of a rig of arrays, its name.
    #[getter]
    fn root(&self) -> PathBuf {
        self.rig.root.clone()
    }

    /// Name of the rig.
    #[getter]
    fn name(&self) -> &str {
        &self.rig.name
    }

    /// Intrinsics as in camera.json: resx, resy (px), K (3 × 3, px), dist_coeffs (OpenCV's).
    #[getter]
    fn camera<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json::to_python(py, &CameraJson::from(&self.rig.camera))
    }

    /// Names of the pattern sets, and the names of their images.
    #[getter]
    fn pattern_sets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let sets = PyDict::new(py);
        for set in &self.rig.pattern_sets {
            sets.set_item(&set.name, &set.images)?;
        }
        Ok(sets)
    }

    /// Names of the board positions; empty without a sweep.
    #[getter]
    fn positions(&self) -> Vec<String> {
        names(self.rig.positions().unwrap_or_default())
    }

    /// Names of the scenes.
    #[getter]
    fn scenes(&self) -> PyResult<Vec<String>> {
        self.rig.scenes().map(names).map_err(exception)
    }

    /// Names of the sequences.
    #[getter]
    fn sequences(&self) -> PyResult<Vec<String>> {
        self.rig.sequences().map(names).map_err(exception)
    }

    /// Reads a scene's images, linear in light: 0 is no light, 1 is clipped. Returns a dictionary of float32 arrays,
    /// height × width (× 3).
    #[pyo3(signature = (scene, set = None))]
    fn read<'py>(&self, py: Python<'py>, scene: &str, set: Option<&str>) -> PyResult<Bound<'py, PyDict>> {
        let (shot, set) = (self.rig.scene(scene).map_err(exception)?, self.set(set)?);
        let capture = work::run(py, None, |_| Ok(self.rig.read_shot(&shot, &set, Need::Scene)?))?;
        let out = PyDict::new(py);
        out.set_item(&self.rig.white, array(py, capture.white)?)?;
        if let Some(black) = capture.black {
            out.set_item(&self.rig.black, array(py, black)?)?;
        }
        for (name, image) in set.images.iter().zip(capture.patterns) {
            out.set_item(name, array(py, image)?)?;
        }
        Ok(out)
    }

    /// Returns everything that is wrong with the rig's folder: a list of {"severity", "message"}.
    #[pyo3(signature = (*, progress = None))]
    fn check<'py>(&self, py: Python<'py>, progress: Option<Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
        if self.rig.memory.is_some() {
            return Err(Error::new_err(
                "a rig of arrays has no folder to check; `calibrate` says what is wrong with it",
            ));
        }
        let found = work::run(py, progress.as_ref(), |_| Ok::<_, Problem>(check(&self.rig.root)))?;
        let found: Vec<_> = found
            .iter()
            .map(|f| serde_json::json!({ "severity": format!("{:?}", f.severity).to_lowercase(), "message": f.to_string() }))
            .collect();
        json::to_python(py, &found)
    }

    fn __repr__(&self) -> String {
        let rig = &self.rig;
        let sets: Vec<_> = rig.pattern_sets.iter().map(|s| format!("{} ({} images)", s.name, s.images.len())).collect();
        format!(
            "<nelu3d.Rig {:?}: {} × {} px, {}, {}>",
            rig.root.display().to_string(),
            rig.camera.width,
            rig.camera.height,
            rig.channels.name(),
            sets.join(", ")
        )
    }
}

fn names(shots: Vec<Shot>) -> Vec<String> {
    shots.into_iter().map(|shot| shot.name).collect()
}

/// Returns an image as an array that owns it.
fn array(py: Python<'_>, image: nelu3d_scan::Image) -> PyResult<Bound<'_, PyArrayDyn<f32>>> {
    let shape = [image.height, image.width, image.channels];
    let dims = if image.channels == 1 { &shape[..2] } else { &shape[..] };
    Array::from(image.data).into_pyarray(py).reshape(dims)
}
