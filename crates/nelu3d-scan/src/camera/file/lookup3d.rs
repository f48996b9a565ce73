//! The LookUp3D tools' JSON: `resx`, `resy`, `K` (3×3), `dist_coeffs`, optional `R` (3×3 or Rodrigues) and `T`.

use nalgebra::Isometry3;
use serde::Serialize;

use super::calibration::Calibration;
use super::error::CameraFileError;
use super::source::Source;
use crate::camera::Camera;

pub(super) fn read(source: &Source) -> Result<Calibration, CameraFileError> {
    let optional = |key| if source.has(key) { source.numbers(key).map(Some) } else { Ok(None) };
    Ok(Calibration {
        width: source.size("resx")?,
        height: source.size("resy")?,
        matrix: source.numbers("K")?,
        distortion: source.numbers("dist_coeffs")?,
        rotation: optional("R")?,
        translation: optional("T")?,
    })
}

#[derive(Serialize)]
#[allow(non_snake_case, reason = "the keys of the format")]
struct File<'a> {
    resx: usize,
    resy: usize,
    K: [[f64; 3]; 3],
    dist_coeffs: &'a [f64],
    #[serde(skip_serializing_if = "Option::is_none")]
    R: Option<[[f64; 3]; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    T: Option<[f64; 3]>,
}

pub(super) fn to_json(camera: &Camera, proj_from_cam: Option<&Isometry3<f64>>) -> String {
    let file = File {
        resx: camera.width,
        resy: camera.height,
        K: camera.matrix().transpose().into(),
        dist_coeffs: camera.distortion.coeffs(),
        R: proj_from_cam.map(|p| p.rotation.to_rotation_matrix().into_inner().transpose().into()),
        T: proj_from_cam.map(|p| p.translation.vector.into()),
    };
    let mut text = serde_json::to_string_pretty(&file).expect("plain numbers serialize");
    text.push('\n');
    text
}
