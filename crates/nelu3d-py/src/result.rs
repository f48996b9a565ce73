//! `Reconstruction`: what a method made of a scene.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nelu3d::Surface;
use nelu3d::progress::StageTime;
use nelu3d::result::{ExtraFiles, Input, ResultMetadata, Summary, write_into};
use nelu3d::verdict::{Judgment, Verdict};
use nelu3d_report::{Captures, ResultReport, surface_page, surface_picture};
use nelu3d_scan::output::{OutputDir, write_atomic};
use nelu3d_scan::rig::{PatternSet, Shot};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde_json::Value;

use crate::display::frame;
use crate::error::{Error, Problem, Refused};
use crate::{arrays, json, work};

/// The surface of a scene, with its uncertainty and whether to trust it. Arrays look at its memory and cannot be
/// written.
#[pyclass(frozen, module = "nelu3d", name = "Reconstruction")]
pub(crate) struct Reconstruction {
    /// The surface.
    pub(crate) surface: Surface,
    /// Whether to trust it.
    pub(crate) judgment: Judgment,
    /// Diagnostics of the method.
    pub(crate) diagnostics: Value,
    /// Wall and CPU time of each stage.
    pub(crate) stages: Vec<StageTime>,
    /// Where the scene comes from.
    pub(crate) rig: Arc<nelu3d_scan::Rig>,
    /// The pattern set.
    pub(crate) set: PatternSet,
    /// The scene or frame.
    pub(crate) shot: Shot,
    /// Files that were read besides the captures: the color field's, for example.
    pub(crate) files: Vec<PathBuf>,
}

impl Reconstruction {
    /// Issues the warnings, and hands the result out unless it is bad.
    ///
    /// # Errors
    ///
    /// The result is bad and that is not accepted: the exception has it as `result`.
    pub(crate) fn hand_out(self, py: Python<'_>, accept: bool) -> PyResult<Py<Self>> {
        for warning in &self.judgment.warnings {
            work::warn(py, &warning.to_string())?;
        }
        let refused = self.judgment.verdict == Verdict::Bad && !accept;
        let why = self.judgment.warnings.first().map_or_else(|| "it is bad".into(), ToString::to_string);
        let name = self.shot.name.clone();
        let result = Py::new(py, self)?;
        if refused {
            let exception = Refused::new_err(format!("{name}: {why}; accept=True returns the result all the same"));
            exception.value(py).setattr("result", result)?;
            return Err(exception);
        }
        Ok(result)
    }

    /// Returns the content of result.json.
    fn summary(&self, inputs: Vec<Input>) -> Summary {
        let about = ResultMetadata {
            rig: self.rig.root.clone(),
            rig_name: self.rig.name.clone(),
            scene: self.shot.name.clone(),
            set: self.set.name.clone(),
            inputs,
            judgment: self.judgment.clone(),
            ..ResultMetadata::default()
        };
        Summary::new(&self.surface, &self.diagnostics, &self.stages, &self.rig.camera, &about)
    }

    /// Hashes the files that were read; of a rig of arrays, none.
    fn inputs(&self) -> Result<Vec<Input>, Problem> {
        let rig = &self.rig;
        let mut paths = self.files.clone();
        if rig.memory.is_none() {
            paths.extend([rig.root.join(nelu3d_scan::rig::RIG_FILE), rig.root.join(&rig.camera_file)]);
            let names = [&rig.white, &rig.black].into_iter().chain(&self.set.images);
            paths.extend(names.map(|name| self.shot.dir.join(name)));
        }
        paths.retain(|path| path.exists());
        let hash = |path: &PathBuf| Input::of(path).map_err(|e| Problem(format!("{}: {e}", path.display())));
        paths.iter().map(hash).collect()
    }

    /// Writes the result folder, as the program does.
    fn write(&self, dir: &Path, extra: ExtraFiles) -> Result<(), Problem> {
        let folder = OutputDir::create(dir, "result.json")?;
        let summary = self.summary(self.inputs()?);
        write_into(folder.path(), &self.surface, &summary, extra)?;
        let captures = Captures::read(&self.rig, &self.set, &self.shot)?;
        let page = ResultReport {
            surface: &self.surface,
            summary: &summary,
            metrics: None,
            trace: None,
            captures: &captures,
            truth: None,
        };
        write_atomic(&folder.path().join("report.html"), |w| w.write_all(page.html().as_bytes()))?;
        Ok(folder.commit()?)
    }

    /// Returns one line about the result.
    fn line(&self) -> String {
        let (valid, all) = (self.surface.n_valid(), self.surface.depth.len());
        format!("{valid} of {all} pixels have a depth; verdict {}", self.judgment.line())
    }
}

type Map<'py> = Bound<'py, PyArrayDyn<f32>>;

/// Returns a map of the result, one value or `tail` values a pixel.
fn map<'py>(this: &Bound<'py, Reconstruction>, tail: &[usize], pick: impl Fn(&Surface) -> &[f32]) -> Map<'py> {
    let surface = &this.get().surface;
    let shape = [&[surface.height, surface.width], tail].concat();
    arrays::view(this.clone().into_any(), &shape, pick(surface))
}

#[pymethods]
impl Reconstruction {
    /// Camera z of each pixel, mm; NaN where there is none. float32, height × width.
    #[getter]
    fn depth<'py>(this: &Bound<'py, Self>) -> Map<'py> {
        map(this, &[], |s| &s.depth)
    }

    /// Unit normals that face the camera; NaN where there is no depth. float32, height × width × 3.
    #[getter]
    fn normals<'py>(this: &Bound<'py, Self>) -> Map<'py> {
        map(this, &[3], |s| s.normals.as_flattened())
    }

    /// One standard deviation of the depth, mm; NaN where there is none. float32, height × width.
    #[getter]
    fn sigma<'py>(this: &Bound<'py, Self>) -> Map<'py> {
        map(this, &[], |s| &s.sigma)
    }

    /// RMS residual over the patterns, normalized intensity; NaN where there is no depth. float32, height × width.
    #[getter]
    fn residual<'py>(this: &Bound<'py, Self>) -> Map<'py> {
        map(this, &[], |s| &s.residual)
    }

    /// Fraction of the light that is ambient, 0 to 1; NaN where it is not known. float32, height × width.
    #[getter]
    fn ambient<'py>(this: &Bound<'py, Self>) -> Map<'py> {
        map(this, &[], |s| &s.ambient)
    }

    /// The white (flash) image, linear in light. float32, height × width (× 3).
    #[getter]
    fn white<'py>(this: &Bound<'py, Self>) -> Map<'py> {
        let tail: &[usize] = if this.get().surface.white.channels == 3 { &[3] } else { &[] };
        map(this, tail, |s| &s.white.data)
    }

    /// Why a pixel has no depth: 0 has one, 1 outside the calibrated volume, 2 clipped, 3 dark, 4 ambiguous, 5 next to
    /// a depth discontinuity. uint8, height × width.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
        let codes: Vec<u8> = self.surface.status.iter().map(|s| *s as u8).collect();
        PyArray1::from_vec(py, codes).reshape(vec![self.surface.height, self.surface.width])
    }

    /// Vertices of the mesh in the camera's frame, mm. float32, n × 3.
    #[getter]
    fn vertices<'py>(this: &Bound<'py, Self>) -> Map<'py> {
        let mesh = &this.get().surface.mesh;
        arrays::view(this.clone().into_any(), &[mesh.vertices.len(), 3], mesh.vertices.as_flattened())
    }

    /// Unit normals of the mesh's vertices. float32, n × 3 (0 × 3 where there are none).
    #[getter]
    fn vertex_normals<'py>(this: &Bound<'py, Self>) -> Map<'py> {
        let mesh = &this.get().surface.mesh;
        arrays::view(this.clone().into_any(), &[mesh.normals.len(), 3], mesh.normals.as_flattened())
    }

    /// Colors of the mesh's vertices, sRGB. uint8, n × 3 (0 × 3 where there are none).
    #[getter]
    fn vertex_colors<'py>(this: &Bound<'py, Self>) -> Bound<'py, PyArrayDyn<u8>> {
        let mesh = &this.get().surface.mesh;
        arrays::view(this.clone().into_any(), &[mesh.colors.len(), 3], mesh.colors.as_flattened())
    }

    /// Triangles of the mesh, as numbers of vertices. uint32, m × 3.
    #[getter]
    fn faces<'py>(this: &Bound<'py, Self>) -> Bound<'py, PyArrayDyn<u32>> {
        let mesh = &this.get().surface.mesh;
        arrays::view(this.clone().into_any(), &[mesh.faces.len(), 3], mesh.faces.as_flattened())
    }

    /// Whether to trust the surface: "good", "doubtful", or "bad".
    #[getter]
    fn verdict(&self) -> String {
        self.judgment.verdict.to_string()
    }

    /// What speaks against the surface: a list of {"code", "verdict", "sentence", "evidence", "remedy"}.
    #[getter]
    fn warnings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json::to_python(py, &self.judgment.warnings)
    }

    /// What is worth knowing and does not speak against the surface, as `warnings`.
    #[getter]
    fn notes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json::to_python(py, &self.judgment.notes)
    }

    /// Diagnostics of the method: settings, losses, counts.
    #[getter]
    fn diagnostics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json::to_python(py, &self.diagnostics)
    }

    /// Seconds of each stage: a list of {"name", "wall_secs", "cpu_secs"}.
    #[getter]
    fn stages<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json::to_python(py, &self.stages)
    }

    /// Name of the scene or frame.
    #[getter]
    fn scene(&self) -> &str {
        &self.shot.name
    }

    /// Writes a result folder, as `nelu3d reconstruct` does, whole or not at all. `also` lists formats besides those of
    /// every result: "obj", "stl", "glb", "3mf", "textured-obj", "textured-glb", "pcd", "e57", "tiff", "exr".
    #[pyo3(signature = (path, *, also = Vec::new()))]
    fn save(&self, py: Python<'_>, path: PathBuf, also: Vec<String>) -> PyResult<()> {
        let mut extra = ExtraFiles::default();
        for name in also {
            if !extra.add(&name) {
                let known = ExtraFiles::NAMES.join(", ");
                return Err(Error::new_err(format!("also: {name:?} is no format; give some of {known}")));
            }
        }
        work::run(py, None, |_| self.write(&path, extra))
    }

    /// Returns a page with the surface, which can be turned, as HTML. It needs no other file and no network.
    fn page(&self) -> String {
        surface_page(&self.shot.name, &self.line(), &self.surface)
    }

    fn _repr_html_(&self) -> String {
        frame(&self.shot.name, &self.page(), 1100)
    }

    fn _repr_png_<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &surface_picture(&self.surface))
    }

    fn __repr__(&self) -> String {
        format!("<nelu3d.Reconstruction of {:?}: {}>", self.shot.name, self.line())
    }
}
