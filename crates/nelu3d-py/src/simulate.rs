//! `simulate`: the rig folder of a virtual scanner.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use nelu3d_sim::Spec;
use nelu3d_sim::spec::PRESETS;
use pyo3::prelude::*;

use crate::error::{Error, exception};
use crate::rig::Rig;
use crate::work;

/// Simulates a scanner into the rig folder `output`, with ground truth, and opens it. `spec` is the name of a preset
/// ("demo", "shapes", …) or the path of a specification (docs/simulator.md). An earlier simulation there is replaced,
/// anything else is not.
#[pyfunction]
#[pyo3(signature = (spec, output, *, progress = None))]
pub(crate) fn simulate(
    py: Python<'_>,
    spec: &Bound<'_, PyAny>,
    output: PathBuf,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<Rig> {
    let path: PathBuf = spec.extract().map_err(|_| Error::new_err("spec: give the name of a preset, or a path"))?;
    let spec = match path.to_str().and_then(Spec::preset) {
        Some(spec) => spec,
        None if path.exists() => Spec::read(&path).map_err(exception)?,
        None => {
            let (known, name) = (PRESETS.map(|(name, _)| name).join(", "), path.display());
            return Err(Error::new_err(format!("`{name}` is neither a preset ({known}) nor a file; name one of them")));
        }
    };
    work::run(py, progress.as_ref(), |progress| {
        let stage = Mutex::new(String::new());
        let report = |name: &str, done, total| {
            let mut stage = stage.lock().unwrap_or_else(PoisonError::into_inner);
            if *stage != name {
                name.clone_into(&mut stage);
                progress.stage(name);
            }
            progress.tick(done, total);
        };
        Ok(nelu3d_sim::simulate_until(&spec, &output, &report, &|| progress.cancelled())?)
    })?;
    Ok(Rig { rig: Arc::new(nelu3d_scan::Rig::open(&output).map_err(exception)?) })
}
