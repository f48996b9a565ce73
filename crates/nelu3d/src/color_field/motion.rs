//! A rigid motion of the light source against the camera, since the sweep.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// A small rigid motion of the light in the camera's frame: a rotation about a point, then a translation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightMotion {
    /// Rodrigues vector of the rotation, radians.
    pub rotation: [f64; 3],
    /// Translation, mm.
    pub translation_mm: [f64; 3],
    /// Point about which it turns, mm.
    pub about_mm: [f64; 3],
}

impl LightMotion {
    /// Returns the motion that leaves everything where it is, to be turned about a point (mm).
    pub fn none(about_mm: [f64; 3]) -> Self {
        Self { rotation: [0.0; 3], translation_mm: [0.0; 3], about_mm }
    }

    /// Returns the motion as a map from where a point that moves with the light was to where it is, camera frame, mm.
    pub fn isometry(&self) -> Isometry3<f64> {
        let about = Translation3::from(Vector3::from(self.about_mm));
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from(self.rotation));
        Translation3::from(Vector3::from(self.translation_mm)) * about * turn * about.inverse()
    }
}
