//! Python's plain data and JSON: how settings come in, and how diagnostics go out.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::{Error, exception};

/// Returns plain data (dictionaries, lists, strings, numbers, numpy's numbers and arrays) as JSON.
pub(crate) fn from_python(data: &Bound<'_, PyAny>) -> PyResult<Value> {
    let py = data.py();
    // What `json` does not know is asked to make itself plain, as arrays and numbers of numpy can.
    let options = PyDict::new(py);
    options.set_item("default", py.import("operator")?.call_method1("methodcaller", ("tolist",))?)?;
    let text: String = py.import("json")?.call_method("dumps", (data,), Some(&options))?.extract()?;
    serde_json::from_str(&text)
        .map_err(|e| Error::new_err(format!("{data}: cannot be used ({e}); give finite numbers")))
}

/// Returns plain data of Python.
pub(crate) fn to_python<'py>(py: Python<'py>, data: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(data).map_err(exception)?;
    py.import("json")?.call_method1("loads", (text,))
}

/// Returns settings: `defaults` with what was given in its place.
///
/// # Errors
///
/// There is no such setting, or it is of another type; the message lists those there are.
pub(crate) fn settings<T: Serialize + DeserializeOwned>(
    defaults: &T,
    given: Option<&Bound<'_, PyDict>>,
) -> PyResult<T> {
    let mut all = serde_json::to_value(defaults).map_err(exception)?;
    if let Some(given) = given {
        merge(&mut all, from_python(given.as_any())?);
    }
    serde_json::from_value(all).map_err(|e| Error::new_err(format!("settings: {e}; correct the argument")))
}

/// Puts `given` in the place of what is in `all`, tables key by key.
fn merge(all: &mut Value, given: Value) {
    match (all, given) {
        (Value::Object(all), Value::Object(given)) => {
            for (key, value) in given {
                merge(all.entry(key).or_insert(Value::Null), value);
            }
        }
        (all, given) => *all = given,
    }
}
