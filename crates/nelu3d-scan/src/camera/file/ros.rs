//! ROS `camera_info`: the calibration file of `camera_calibration` (`image_width`, `camera_matrix`, …), or a recorded
//! message (`width`, `K` or `k`, `D` or `d`, …). It has no place for a projector's pose: `R` is the rectification.

use super::calibration::Calibration;
use super::error::CameraFileError;
use super::opencv;
use super::source::Source;

pub(super) fn read(source: &Source) -> Result<Calibration, CameraFileError> {
    let model = source.value("distortion_model")?;
    // An empty name is what uncalibrated drivers send along with an empty list of coefficients.
    if !matches!(model.as_str(), Some("plumb_bob" | "rational_polynomial" | "")) {
        let problem = format!("is {}", model.as_str().unwrap_or("not a name"));
        let remedy = "only plumb_bob and rational_polynomial are OpenCV's pinhole model: calibrate with one of them";
        return Err(source.invalid("distortion_model", problem, remedy));
    }
    // ROS 1 spells the message's fields with capitals, ROS 2 without.
    let first = |keys: [&'static str; 3]| keys.into_iter().find(|key| source.has(key)).unwrap_or(keys[0]);
    Ok(Calibration {
        width: source.size(first(["image_width", "width", "width"]))?,
        height: source.size(first(["image_height", "height", "height"]))?,
        matrix: opencv::matrix(source, first(["camera_matrix", "K", "k"]))?,
        distortion: opencv::matrix(source, first(["distortion_coefficients", "D", "d"]))?,
        rotation: None,
        translation: None,
    })
}
