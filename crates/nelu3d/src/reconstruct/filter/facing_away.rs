//! Surfaces that are turned away from the light.
//!
//! Nothing of them would be lit, so their depth is wrong. A code that repeats makes such surfaces of a wall outside the
//! calibrated volume: for each period a strip that runs through all of the volume, from its back to its front, across
//! the rays of light. Each fits as well as a true surface does.

use nalgebra::Vector3;
use nelu3d_scan::Camera;
use nelu3d_scan::image::box_mean;

use crate::surface::{Links, MAX_SLOPE, PixelStatus, normals_from_links};

/// Radius over which the side that a surface shows to the light is averaged, px: single normals are noisy, and wrong
/// beside jumps of depth.
const RADIUS: usize = 2;
/// By how much the light may stand elsewhere across the epipolar planes, over its distance. Codes that vary along one
/// axis tell its center only up to a line.
const ACROSS: f32 = 0.5;

/// Rejects the pixels of a depth map (camera z, mm; NaN: none) whose surface is turned away from a light at `light`,
/// mm, in the camera's frame, as [`PixelStatus::Ambiguous`]. `plane` is the image plane: x/z and y/z of every pixel's
/// ray.
pub fn reject_facing_away(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    camera: &Camera,
    plane: &[[f32; 2]],
    light: Vector3<f32>,
) {
    let (w, h) = (camera.width, camera.height);
    let normals = normals_from_links(depth, &Links::new(depth, camera, MAX_SLOPE), plane, w);
    let known = |i: usize| depth[i].is_finite() && normals[i][2].is_finite();
    let mut side: Vec<f32> = (0..w * h)
        .map(|i| {
            let point = Vector3::new(plane[i][0], plane[i][1], 1.0) * depth[i];
            if known(i) { towards(light, point, normals[i].into()) } else { 0.0 }
        })
        .collect();
    box_mean(&mut side, w, h, RADIUS);
    // Pixels at the border of a steep sheet have no normal of their own.
    for i in (0..w * h).filter(|i| side[*i] < 0.0) {
        if depth[i].is_finite() {
            (depth[i], status[i]) = (f32::NAN, PixelStatus::Ambiguous);
        }
    }
}

/// Returns the cosine between the normal of a surface at a point and the direction to a light: the largest of those
/// that the light's center may have (see [`ACROSS`]).
fn towards(light: Vector3<f32>, point: Vector3<f32>, normal: Vector3<f32>) -> f32 {
    // Across the plane through camera, light, and point.
    let across = light.cross(&point).try_normalize(0.0).unwrap_or_default();
    let direction = (light - point).try_normalize(0.0).unwrap_or_default();
    normal.dot(&direction) + ACROSS * normal.dot(&across).abs()
}
