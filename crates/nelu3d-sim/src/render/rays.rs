//! Viewing rays anywhere in a pixel, fast: the lens's distortion is inverted at the pixels' corners only.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Ray;
use nelu3d_scan::camera::Camera;
use rayon::prelude::*;

/// Undistorted image coordinates of all pixel corners, with a margin of pixels around the image.
#[derive(Debug)]
pub struct RayGrid {
    margin: i64,
    columns: usize,
    corners: Vec<[f64; 2]>,
}

impl RayGrid {
    /// Computes the rays of all pixels and of `margin_px` around them.
    pub fn new(camera: &Camera, margin_px: usize) -> Self {
        let columns = camera.width + 2 * margin_px + 1;
        let rows = camera.height + 2 * margin_px + 1;
        let offset = margin_px as f64 + 0.5;
        let corners = (0..columns * rows)
            .into_par_iter()
            .map(|i| camera.undistort([(i % columns) as f64 - offset, (i / columns) as f64 - offset]))
            .collect();
        Self { margin: margin_px as i64, columns, corners }
    }

    /// Returns the ray through pixel (x, y) at (fx, fy) of its width and height from its top left corner, all in `[0,
    /// 1]`.
    pub fn ray(&self, x: i64, y: i64, fx: f64, fy: f64) -> Ray {
        let i = (y + self.margin) as usize * self.columns + (x + self.margin) as usize;
        let [a, b] = [self.corners[i], self.corners[i + 1]];
        let [c, d] = [self.corners[i + self.columns], self.corners[i + self.columns + 1]];
        let at = |k: usize| {
            let (top, bottom) = (a[k] + fx * (b[k] - a[k]), c[k] + fx * (d[k] - c[k]));
            top + fy * (bottom - top)
        };
        Ray { origin: Point3::origin(), dir: Vector3::new(at(0), at(1), 1.0).normalize() }
    }
}
