//! Surfaces that are turned away from the light.
//!
//! Nothing of them would be lit, so their depth is wrong. A code that repeats makes such surfaces of a wall outside the
//! calibrated volume: for each period a strip that runs through all of the volume, from its back to its front, across the
//! rays of light. Each fits as well as a true surface does.

use nelu3d_scan::Camera;
use nelu3d_scan::image::box_mean;

use crate::surface::{Links, MAX_SLOPE, PixelStatus, normals_from_links};

/// Radius over which the side that a surface shows to the light is averaged, px: single normals are noisy, and wrong
/// beside jumps of depth.
const RADIUS: usize = 2;
/// By how much the light may stand elsewhere across the epipolar planes, over its distance. Codes that vary along one axis
/// tell its center only up to a line.
const ACROSS: f32 = 0.5;

/// Rejects the pixels of a depth map (camera z, mm; NaN: none) whose surface is turned away from a light at `light`, mm, in
/// the camera's frame, as [`PixelStatus::Ambiguous`]. `plane` is the image plane: x/z and y/z of every pixel's ray.
pub fn reject_facing_away(
    depth: &mut [f32],
    status: &mut [PixelStatus],
    camera: &Camera,
    plane: &[[f32; 2]],
    light: [f32; 3],
) {
    let (w, h) = (camera.width, camera.height);
    let normals = normals_from_links(depth, &Links::new(depth, camera, MAX_SLOPE), plane, w);
    let known = |i: usize| depth[i].is_finite() && normals[i][2].is_finite();
    let mut side: Vec<f32> = (0..w * h)
        .map(|i| if known(i) { towards(light, plane[i].map(|v| v * depth[i]), depth[i], normals[i]) } else { 0.0 })
        .collect();
    box_mean(&mut side, w, h, RADIUS);
    // Pixels at the border of a steep sheet have no normal of their own.
    for i in (0..w * h).filter(|i| side[*i] < 0.0) {
        if depth[i].is_finite() {
            (depth[i], status[i]) = (f32::NAN, PixelStatus::Ambiguous);
        }
    }
}

/// Returns the cosine between the normal of a surface at (x, y, z) and the direction of a light, of those that the light's
/// center may have (see [`ACROSS`]) the largest.
fn towards(light: [f32; 3], [x, y]: [f32; 2], z: f32, normal: [f32; 3]) -> f32 {
    let point = [x, y, z];
    let direction = [0, 1, 2].map(|a| light[a] - point[a]);
    let length = norm(direction);
    // Across the plane through camera, light, and point.
    let across = cross(light, point);
    let turned = dot(normal, across).abs() / norm(across).max(f32::MIN_POSITIVE);
    dot(normal, direction) / length.max(f32::MIN_POSITIVE) + ACROSS * turned
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: [f32; 3]) -> f32 {
    dot(a, a).sqrt()
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
