//! OpenCV `FileStorage`: `image_width`, `image_height`, `camera_matrix`, `distortion_coefficients`, optional `R`, `T`.

use super::calibration::Calibration;
use super::error::CameraFileError;
use super::source::Source;

pub(super) fn read(source: &Source) -> Result<Calibration, CameraFileError> {
    let optional = |key| if source.has(key) { matrix(source, key).map(Some) } else { Ok(None) };
    Ok(Calibration {
        width: source.size("image_width")?,
        height: source.size("image_height")?,
        matrix: matrix(source, "camera_matrix")?,
        distortion: matrix(source, "distortion_coefficients")?,
        rotation: optional("R")?,
        translation: optional("T")?,
    })
}

/// Returns the numbers of a matrix, row by row: a node `{rows, cols, dt, data}`, or plain nested lists.
pub(super) fn matrix(source: &Source, key: &str) -> Result<(String, Vec<f64>), CameraFileError> {
    let node = source.value(key)?;
    let Some(data) = node.get("data") else {
        if node.is_mapping() {
            return Err(source.missing(&format!("{key}.data"), "a matrix has rows, cols and data"));
        }
        return source.numbers(key);
    };
    let numbers = source.flatten(key, data)?;
    let size = |name| node.get(name).and_then(serde_yaml_ng::Value::as_u64);
    if let (Some(rows), Some(cols)) = (size("rows"), size("cols"))
        && rows.saturating_mul(cols) != numbers.len() as u64
    {
        let problem = format!("says {rows}x{cols} but has {} numbers", numbers.len());
        return Err(source.invalid(key, problem, "make rows, cols and data agree"));
    }
    Ok((key.into(), numbers))
}
