//! Camera and projector files. Three formats are read, told apart by their keys; the first is written:
//!
//! - [`lookup3d`]: the LookUp3D tools' JSON (`resx`, `resy`, `K`, `dist_coeffs`, optional `R`, `T`);
//! - [`opencv`]: OpenCV `FileStorage`, YAML or JSON (`camera_matrix`, `distortion_coefficients`);
//! - [`ros`]: ROS `camera_info`, as calibration file or as a recorded message.
//!
//! Each turns the file into a [`Calibration`], whose values are checked here, once for all formats.

mod calibration;
mod error;
mod lookup3d;
mod opencv;
mod ros;
mod source;

use std::io;
use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

pub use error::CameraFileError;

use self::calibration::Calibration;
use self::source::Source;
use super::{Camera, Distortion, Projector};
use crate::output::write_atomic;

/// Focal lengths that a lens can have, in units of the longer side of its images: from 168 degrees of view, beyond
/// what the lens model describes, to a twentieth of a degree.
const FOCAL_LENGTHS: [f64; 2] = [0.05, 1000.0];
/// Largest distance of the principal point from the image's corner, in units of the longer side: a far crop.
const FARTHEST_CENTER: f64 = 100.0;

/// Reads camera intrinsics. `R` and `T`, if there are any, are checked and not used: the camera's frame is the world.
///
/// # Errors
///
/// The file cannot be read or parsed, a key is missing, or a value is impossible; the message names file and key.
pub fn read_camera(path: &Path) -> Result<Camera, CameraFileError> {
    camera_of(&Source::read(path)?)
}

/// Reads camera intrinsics from the content of a file, as [`read_camera`] does; `path` is only for messages.
///
/// # Errors
///
/// As [`read_camera`], but for what concerns the file itself.
pub fn camera_from_bytes(path: &Path, bytes: &[u8]) -> Result<Camera, CameraFileError> {
    camera_of(&Source::parse(path, bytes)?)
}

fn camera_of(source: &Source) -> Result<Camera, CameraFileError> {
    let calibration = read_any(source)?;
    let camera = camera(source, &calibration)?;
    rotation(source, &calibration)?;
    translation(source, &calibration)?;
    Ok(camera)
}

/// Reads a projector: intrinsics and `R`, `T` with `X_projector = R X_camera + T` (mm).
///
/// # Errors
///
/// As for [`read_camera`]; `R` and `T` are required.
pub fn read_projector(path: &Path) -> Result<Projector, CameraFileError> {
    projector_of(&Source::read(path)?)
}

/// Reads a projector from the content of a file, as [`read_projector`] does; `path` is only for messages.
///
/// # Errors
///
/// As [`read_projector`], but for what concerns the file itself.
pub fn projector_from_bytes(path: &Path, bytes: &[u8]) -> Result<Projector, CameraFileError> {
    projector_of(&Source::parse(path, bytes)?)
}

fn projector_of(source: &Source) -> Result<Projector, CameraFileError> {
    let calibration = read_any(source)?;
    let optics = camera(source, &calibration)?;
    let missing = |key| {
        source.missing(key, "a projector needs R and T (X_projector = R X_camera + T, mm), as stereo calibration gives")
    };
    let rotation = rotation(source, &calibration)?.ok_or_else(|| missing("R"))?;
    let translation = translation(source, &calibration)?.ok_or_else(|| missing("T"))?;
    Ok(Projector { optics, proj_from_cam: Isometry3::from_parts(translation, rotation) })
}

/// Writes camera intrinsics in the LookUp3D tools' format.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_camera(path: &Path, camera: &Camera) -> io::Result<()> {
    let text = lookup3d::to_json(camera, None);
    write_atomic(path, |w| w.write_all(text.as_bytes()))
}

/// Writes a projector in the LookUp3D tools' format.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_projector(path: &Path, projector: &Projector) -> io::Result<()> {
    let text = projector_json(projector);
    write_atomic(path, |w| w.write_all(text.as_bytes()))
}

/// Returns the content of the file that [`write_projector`] writes: one JSON object.
pub fn projector_json(projector: &Projector) -> String {
    lookup3d::to_json(&projector.optics, Some(&projector.proj_from_cam))
}

fn read_any(source: &Source) -> Result<Calibration, CameraFileError> {
    if source.has("distortion_model") {
        ros::read(source)
    } else if source.has("camera_matrix") {
        opencv::read(source)
    } else if source.has("resx") || source.has("resy") || source.has("K") || source.has("dist_coeffs") {
        lookup3d::read(source)
    } else {
        let remedy = "a camera file has resx, resy, K, dist_coeffs (LookUp3D) or image_width, image_height, \
                      camera_matrix, distortion_coefficients (OpenCV, ROS)";
        Err(source.missing("K", remedy))
    }
}

fn camera(source: &Source, c: &Calibration) -> Result<Camera, CameraFileError> {
    for (key, size) in [&c.width, &c.height] {
        if *size == 0 || *size > 1 << 16 {
            return Err(source.invalid(key, format!("is {size}"), "give the size of the images, in pixels"));
        }
    }
    let (key, k) = &c.matrix;
    finite(source, key, k)?;
    let &[fx, skew, cx, k10, fy, cy, k20, k21, k22] = k.as_slice() else {
        return Err(source.invalid(
            key,
            format!("has {} numbers", k.len()),
            "give all nine of [[fx,0,cx],[0,fy,cy],[0,0,1]]",
        ));
    };
    for (name, f) in [("fx", fx), ("fy", fy)] {
        if f <= 0.0 {
            let remedy = "a focal length is positive, in pixels: calibrate again, or undo the flip of the image";
            return Err(source.invalid(key, format!("has the focal length {name} = {f:?}"), remedy));
        }
        let side = c.width.1.max(c.height.1);
        let [shortest, longest] = FOCAL_LENGTHS.map(|sides| sides * side as f64);
        if !(shortest..=longest).contains(&f) {
            let problem = format!("has the focal length {name} = {f:?} px, for images of up to {side} px");
            let remedy = format!(
                "give it in pixels: lenses of such images have {shortest:.0} to {longest:.0} px, for example 1.2 times \
                 the width for 45 degrees"
            );
            return Err(source.invalid(key, problem, &remedy));
        }
    }
    if [skew, k10, k20, k21] != [0.0; 4] || k22 != 1.0 {
        let remedy = "it must have the form [[fx,0,cx],[0,fy,cy],[0,0,1]]: no skew, rows first";
        return Err(source.invalid(key, format!("is {k:?}"), remedy));
    }
    let farthest = FARTHEST_CENTER * c.width.1.max(c.height.1) as f64;
    if cx.abs() > farthest || cy.abs() > farthest {
        let problem = format!("has its principal point at ({cx:?}, {cy:?}) px, far outside of the image");
        return Err(source.invalid(key, problem, "give it in pixels from the middle of the top-left pixel"));
    }
    let (key, d) = &c.distortion;
    finite(source, key, d)?;
    let distortion = Distortion::new(d).ok_or_else(|| {
        let remedy = "OpenCV's model has 0, 4, 5, 8, 12 or 14: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y";
        source.invalid(key, format!("has {} coefficients", d.len()), remedy)
    })?;
    Ok(Camera { width: c.width.1, height: c.height.1, fx, fy, cx, cy, distortion })
}

/// Returns the rotation, from a 3×3 matrix or a Rodrigues vector.
fn rotation(source: &Source, c: &Calibration) -> Result<Option<UnitQuaternion<f64>>, CameraFileError> {
    let Some((key, r)) = &c.rotation else { return Ok(None) };
    finite(source, key, r)?;
    match r.as_slice() {
        &[x, y, z] => Ok(Some(UnitQuaternion::from_scaled_axis(Vector3::new(x, y, z)))),
        nine if nine.len() == 9 => {
            let m = Matrix3::from_row_slice(nine);
            // Files keep few digits; a matrix off by more than that is something else than a rotation.
            let off = (m.transpose() * m - Matrix3::identity()).amax();
            if off > 1e-3 || m.determinant() < 0.0 {
                let problem = format!("is no rotation (R^T R is off by {off:.2e}, determinant {:.3})", m.determinant());
                return Err(source.invalid(
                    key,
                    problem,
                    "give an orthonormal, right-handed 3x3 matrix or a Rodrigues vector",
                ));
            }
            let nearest = Rotation3::from_matrix_eps(&m, 1e-15, 100, Rotation3::from_matrix_unchecked(m));
            Ok(Some(UnitQuaternion::from_rotation_matrix(&nearest)))
        }
        other => {
            let problem = format!("has {} numbers", other.len());
            Err(source.invalid(key, problem, "give a 3x3 matrix or a Rodrigues vector of 3"))
        }
    }
}

fn translation(source: &Source, c: &Calibration) -> Result<Option<Translation3<f64>>, CameraFileError> {
    let Some((key, t)) = &c.translation else { return Ok(None) };
    finite(source, key, t)?;
    match t.as_slice() {
        &[x, y, z] => Ok(Some(Translation3::new(x, y, z))),
        other => Err(source.invalid(key, format!("has {} numbers", other.len()), "give three, in millimeters")),
    }
}

fn finite(source: &Source, key: &str, values: &[f64]) -> Result<(), CameraFileError> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(v) => Err(source.invalid(key, format!("holds {v}"), "the calibration failed: repeat it")),
        None => Ok(()),
    }
}
