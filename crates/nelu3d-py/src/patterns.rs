//! `patterns`: the images a light source shows.

use nelu3d_scan::pattern::{Axis, Pattern, PatternImage, generate, recommended_patterns};
use numpy::ndarray::Array;
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;

use crate::error::{Error, exception};
use crate::json::from_python;

/// Makes the images of a pattern family for a light source of `size` = (width, height) px: a dictionary, name → float32
/// array, height × width (× 3), values in 0 … 1 linear in light. Family "recommended" takes `images` (3, 5, or 8) and
/// `axis` ("x" or "y"); the others take their settings as in `nelu3d patterns FAMILY`.
#[pyfunction]
#[pyo3(signature = (family = "recommended", *, size, **settings))]
pub(crate) fn patterns<'py>(
    py: Python<'py>,
    family: &str,
    size: (usize, usize),
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (width, height) = size;
    let settings = settings.map_or_else(|| Ok(serde_json::json!({})), |s| from_python(s.as_any()))?;
    let Value::Object(mut settings) = settings else { return Err(Error::new_err("settings: give names and values")) };
    let wrong = |e: serde_json::Error| Error::new_err(format!("patterns {family}: {e}; correct the settings"));
    let set = if family == "recommended" {
        let images = settings.remove("images").map_or(Ok(3), serde_json::from_value).map_err(wrong)?;
        let axis: Axis = settings.remove("axis").map_or(Ok(Axis::X), serde_json::from_value).map_err(wrong)?;
        if let Some(unknown) = settings.keys().next() {
            return Err(Error::new_err(format!(
                "patterns recommended: there is no setting {unknown:?}; give images, axis"
            )));
        }
        let length = if axis == Axis::X { width } else { height };
        recommended_patterns(length, axis, images).map_err(exception)?
    } else {
        settings.insert("family".into(), family.into());
        vec![serde_json::from_value::<Pattern>(Value::Object(settings)).map_err(wrong)?]
    };
    let made = generate(&set, width, height).map_err(exception)?;
    let out = PyDict::new(py);
    for PatternImage { name, image } in made.images.into_iter().chain(made.inverse) {
        let lines =
            Array::from_shape_vec((image.height, image.width, image.channels), image.data).map_err(exception)?;
        let whole = lines.broadcast((height, width, image.channels));
        let whole = whole.ok_or_else(|| Error::new_err("a pattern has another size than asked for"))?;
        let array = whole.to_owned().into_pyarray(py);
        let dims: &[usize] = if image.channels == 1 { &[height, width] } else { &[height, width, 3] };
        out.set_item(name, array.reshape(dims)?)?;
    }
    Ok(out)
}
