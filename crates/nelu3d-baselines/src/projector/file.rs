//! The projector on disk, with its response.

use std::path::Path;

use nelu3d_scan::Projector;
use nelu3d_scan::camera::projector_json;
use nelu3d_scan::input::read_text;

use super::report::ProjectorReport;
use crate::error::DecodeError;
use crate::response::Response;

/// Writes a projector file: `projector.json` in the LookUp3D tools' form, with two keys that other readers ignore:
/// `calibration` (what [`ProjectorReport`] says of its quality) and `response` (see [`Response`]).
///
/// # Errors
///
/// The file cannot be written.
pub fn write(path: &Path, projector: &Projector, report: &ProjectorReport) -> std::io::Result<()> {
    let mut json: serde_json::Map<String, serde_json::Value> = serde_json::from_str(&projector_json(projector))?;
    let calibration = serde_json::json!({
        "set": report.set,
        "positions": report.positions,
        "corners": report.corners,
        "rms_px": report.rms_px,
        "depth_mm": report.depth_mm,
        "version": env!("CARGO_PKG_VERSION"),
    });
    json.insert("calibration".into(), calibration);
    if let Some(response) = &report.response {
        json.insert("response".into(), serde_json::to_value(response)?);
    }
    nelu3d_scan::output::write_atomic(path, |w| {
        serde_json::to_writer_pretty(&mut *w, &json)?;
        w.write_all(b"\n")
    })
}

/// Reads the response of a projector file that [`write`] wrote; `None` if it has none.
pub(crate) fn read_response(path: &Path) -> Result<Option<Response>, DecodeError> {
    // Other formats than ours have no response.
    let Some(json) = read_text(path).ok().and_then(|text| serde_json::from_str::<serde_json::Value>(&text).ok()) else {
        return Ok(None);
    };
    let Some(value) = json.get("response") else { return Ok(None) };
    let broken = |problem: String| {
        DecodeError::file(
            path,
            format!("`response` {problem}"),
            "write it again with `nelu3d projector`, or give setting `gamma`",
        )
    };
    let response: Response =
        serde_json::from_value(value.clone()).map_err(|e| broken(format!("is no response: {e}")))?;
    response.check().map_err(|problem| broken(problem.into()))?;
    Ok(Some(response))
}
