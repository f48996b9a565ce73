//! Light that arrives at a surface point.

use nalgebra::{Point3, Vector3};

use crate::geometry::power;

/// The light that can arrive at a surface point: what a light source needs to know for all images of a shot.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LightSample {
    /// Irradiance of white and of pattern light there, if nothing were in its way; 0 in shadow.
    pub(super) strength: [f32; 2],
    /// Point on the light's image plane: px of a projector, mm of a film.
    pub(super) uv: [f64; 2],
    /// Standard deviation of the blur there, in the unit of `uv`.
    pub(super) sigma: f64,
}

/// Returns the irradiance at a surface point `p` from a small lamp at `lamp` with intensity cosⁿ about `axis`, n being
/// `vignetting`: inverse square law, the surface's cosine, and the lamp's fall-off. It is 1 for a surface that faces
/// the lamp on its axis at `reference_mm`.
pub(super) fn point_light_irradiance(
    p: &Point3<f64>,
    normal: &Vector3<f64>,
    lamp: &Point3<f64>,
    axis: &Vector3<f64>,
    reference_mm: f64,
    vignetting: f64,
) -> f32 {
    let to_lamp = lamp - p;
    let distance = to_lamp.norm();
    let dir = to_lamp / distance;
    let (cosine, off_axis) = (normal.dot(&dir), -axis.dot(&dir));
    // NaN, for a point in the lamp itself, is no light either.
    if !(cosine > 0.0 && off_axis > 0.0) {
        return 0.0;
    }
    ((reference_mm / distance).powi(2) * cosine * power(off_axis, vignetting)) as f32
}
