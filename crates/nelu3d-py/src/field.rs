//! `ColorField` and `calibrate`.

use std::path::PathBuf;
use std::sync::Arc;

use nelu3d::color_field::SplineEvaluator;
use nelu3d::verdict::Verdict;
use nelu3d::{CalibrationOptions, CalibrationReport};
use nelu3d_report::html::{escape, table};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use crate::error::{Error, Problem, Refused, exception};
use crate::rig::Rig;
use crate::{json, work};

/// The calibrated color field c: the codeword of every point of the volume in which the board was.
#[pyclass(frozen, module = "nelu3d", name = "ColorField")]
pub(crate) struct ColorField {
    /// The field.
    pub(crate) field: Arc<nelu3d::ColorField>,
    /// The report of its calibration; none for one that was loaded.
    report: Option<CalibrationReport>,
    /// The file that it was loaded from.
    pub(crate) file: Option<PathBuf>,
}

impl ColorField {
    /// Loads a field.
    pub(crate) fn read(path: PathBuf) -> PyResult<Self> {
        let field = nelu3d::ColorField::load(&path).map_err(exception)?;
        Ok(Self { field: Arc::new(field), report: None, file: Some(path) })
    }
}

#[pymethods]
impl ColorField {
    /// Loads a field from its file.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        Self::read(path)
    }

    /// Writes the field, whole or not at all.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        work::run(py, None, |_| Ok(self.field.save(&path)?))
    }

    /// Evaluates c at points of the camera's frame (x right, y down, z forward; mm): n × 3 in, float32 n × k out, values
    /// of normalized intensity. Points outside the calibrated volume have NaN, unless `extrapolate`.
    #[pyo3(signature = (points, *, extrapolate = false))]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        extrapolate: bool,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let array = py.import("numpy")?.call_method1("ascontiguousarray", (points, "float64"))?;
        let wrong = || Error::new_err("points: give n × 3 numbers, mm");
        let points: PyReadonlyArray2<'_, f64> = array.extract().map_err(|_| wrong())?;
        let flat = points.as_slice().map_err(|_| wrong())?;
        if points.as_array().ncols() != 3 {
            return Err(wrong());
        }
        let (field, k) = (&self.field, self.field.k());
        let values = work::run(py, None, |_| {
            let grid = field.to_grid();
            let spline = SplineEvaluator::new(&grid, field.metadata.cells_per_pixel);
            let mut values = vec![f32::NAN; flat.len() / 3 * k];
            values.par_chunks_exact_mut(k).zip(flat.par_chunks_exact(3)).for_each(|(out, p)| {
                let point = nalgebra::Point3::new(p[0], p[1], p[2]);
                let unit = field.frame.to_unit(&point).filter(|q| q.iter().all(|v| v.is_finite()));
                if let Some(q) = unit.filter(|q| extrapolate || field.validity.is_lit(*q)) {
                    spline.eval(q, out);
                }
            });
            Ok(values)
        })?;
        let values = Array2::from_shape_vec((values.len() / k, k), values).map_err(exception)?;
        Ok(values.into_pyarray(py))
    }

    /// Number of values of a codeword: images × channels.
    #[getter]
    fn k(&self) -> usize {
        self.field.k()
    }

    /// Form in which c is stored: "grid", "hash", or "frequency".
    #[getter]
    fn form(&self) -> &'static str {
        self.field.form_name()
    }

    /// Corners of the smallest box around the calibrated volume, camera frame, mm: float64, 2 × 3.
    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let bounds = work::run(py, None, |_| Ok(bounds(&self.field)))?;
        Ok(Array2::from_shape_vec((2, 3), bounds.as_flattened().to_vec()).map_err(exception)?.into_pyarray(py))
    }

    /// Quality at held-out board positions: {"psnr_db", "ceiling_db", "depth_mm", "pose_mm", …}; None where none was
    /// measured.
    #[getter]
    fn quality<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json::to_python(py, &self.field.metadata.quality)
    }

    /// What the field was made from: rig, set, images, noise, settings, codes of its warnings, …
    #[getter]
    fn metadata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json::to_python(py, &self.field.metadata)
    }

    /// The report of the calibration, as `nelu3d calibrate --json` has it; None for a field that was loaded.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json::to_python(py, &self.report)
    }

    fn _repr_html_(&self) -> String {
        let m = &self.field.metadata;
        let mut rows = vec![
            vec!["rig".to_owned(), m.rig.clone()],
            vec!["pattern set".into(), format!("{} ({})", m.set, m.images.join(", "))],
            vec!["form".into(), self.field.form_name().into()],
        ];
        if let Some(report) = &self.report {
            rows.push(vec!["verdict".into(), report.judgment.line()]);
        }
        if let Some(q) = &m.quality {
            let db = format!("{:.1} dB (noise alone: about {:.1} dB)", q.psnr_db, q.ceiling_db);
            rows.push(vec!["at held-out positions".into(), db]);
            rows.push(vec!["median depth error there".into(), format!("{:.3} mm", q.depth_mm)]);
        }
        format!("<b>{}</b>{}", escape("nelu3d.ColorField"), table(&["", ""], &rows))
    }

    fn __repr__(&self) -> String {
        let m = &self.field.metadata;
        let quality = m.quality.as_ref().map(|q| format!(", {:.1} dB at held-out positions", q.psnr_db));
        format!(
            "<nelu3d.ColorField of {:?}, set {}, k = {}{}>",
            m.rig,
            m.set,
            self.field.k(),
            quality.unwrap_or_default()
        )
    }
}

/// Returns the corners of the smallest box around the calibrated cells, mm.
fn bounds(field: &nelu3d::ColorField) -> [[f64; 3]; 2] {
    let [na, nb, nw] = field.validity.shape.cells;
    let mut corners = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for (i, column) in field.validity.lit.chunks_exact(nw).enumerate() {
        let ends = (column.iter().position(|l| *l == 1), column.iter().rposition(|l| *l == 1));
        let (Some(first), Some(last)) = ends else { continue };
        for corner in 0..8 {
            let w = if corner & 4 == 0 { first } else { last + 1 };
            let q = [(i % na + (corner & 1)) as f64 / na as f64, (i / na + (corner >> 1 & 1)) as f64 / nb as f64];
            let point = field.frame.from_unit([q[0], q[1], w as f64 / nw as f64]);
            for axis in 0..3 {
                corners[0][axis] = corners[0][axis].min(point[axis]);
                corners[1][axis] = corners[1][axis].max(point[axis]);
            }
        }
    }
    corners
}

/// Returns a field as its file has it, in half precision: surfaces are the program's to the last bit, whether a field
/// came from a file or not.
fn as_stored(field: &nelu3d::ColorField) -> Result<nelu3d::ColorField, Problem> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("field.safetensors");
    field.save(&path)?;
    Ok(nelu3d::ColorField::load(&path)?)
}

/// Calibrates a rig for one pattern set from its board sweep: the same field as `nelu3d calibrate` writes. Settings are
/// those of the program with underscores.
#[pyfunction]
#[pyo3(signature = (rig, *, set = None, accept = false, device = "auto", progress = None, **settings))]
pub(crate) fn calibrate(
    py: Python<'_>,
    rig: &Bound<'_, Rig>,
    set: Option<&str>,
    accept: bool,
    device: &str,
    progress: Option<Bound<'_, PyAny>>,
    settings: Option<&Bound<'_, PyDict>>,
) -> PyResult<ColorField> {
    let (rig, set) = (rig.get(), rig.get().set(set)?);
    let mut options: CalibrationOptions = json::settings(&CalibrationOptions::default(), settings)?;
    options.device = crate::work::device(device)?;
    let (field, report) = work::run(py, progress.as_ref(), |progress| {
        let (field, report) = nelu3d::calibrate(&rig.rig, &set, &options, progress)?;
        Ok((as_stored(&field)?, report))
    })?;
    for warning in &report.judgment.warnings {
        work::warn(py, &warning.to_string())?;
    }
    let refused = report.judgment.verdict == Verdict::Bad && !accept;
    let why = report.judgment.warnings.first().map(ToString::to_string).unwrap_or_default();
    let field = ColorField { field: Arc::new(field), report: Some(report), file: None };
    if refused {
        let name = rig.rig.root.display();
        let exception = Refused::new_err(format!("{name}: {why}; accept=True returns the field all the same"));
        exception.value(py).setattr("result", Py::new(py, field)?)?;
        return Err(exception);
    }
    Ok(field)
}
