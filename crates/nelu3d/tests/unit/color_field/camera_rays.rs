//! Rays for tests.

use nalgebra::{Point3, Vector3};
use nelu3d::color_field::CameraRays;
use nelu3d::color_field::frame::FieldFrame;
use nelu3d::color_field::validity::KnownAxes;

/// Makes the rays of a camera without a field.
pub(crate) fn rays_without_field(focal_px: f32, plane: Vec<[f32; 2]>) -> CameraRays {
    let frame = FieldFrame::around(Point3::origin(), Point3::new(0.0, 0.0, 500.0), Vector3::x());
    let range = vec![[0.0, 1e9]; plane.len()];
    rays_of_field(focal_px, plane, range, frame)
}

/// Makes the rays of a field without a camera.
pub(crate) fn rays_of_field(
    focal_px: f32,
    plane: Vec<[f32; 2]>,
    range: Vec<[f32; 2]>,
    frame: FieldFrame,
) -> CameraRays {
    let known = vec![KnownAxes::ALL; plane.len()];
    CameraRays { focal_px, plane, range, known, frame }
}
