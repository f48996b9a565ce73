//! Viewing rays anywhere in a pixel, fast: the lens's distortion is inverted at the pixels' corners only.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Ray;
use nelu3d_scan::camera::Camera;
use rayon::prelude::*;

/// Undistorted image coordinates of all pixel corners, with a margin of pixels around the image.
#[derive(Debug)]
pub(crate) struct RayGrid {
    margin: i64,
    columns: usize,
    corners: Vec<[f64; 2]>,
}

impl RayGrid {
    /// Computes the rays of all pixels and of `margin_px` around them.
    pub(crate) fn new(camera: &Camera, margin_px: usize) -> Self {
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
    pub(crate) fn ray(&self, x: i64, y: i64, fx: f64, fy: f64) -> Ray {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::Spec;

    #[test]
    fn rays_are_the_cameras_to_a_ten_thousandth_of_a_pixel() {
        let camera = Spec::preset("demo").unwrap().camera.optics().unwrap();
        let grid = RayGrid::new(&camera, 2);
        for (x, y) in [(-2, -2), (0, 0), (100, 17), (160, 119), (321, 241)] {
            for (fx, fy) in [(0.0, 0.0), (0.5, 0.5), (0.3, 0.9)] {
                let px = camera.project(&grid.ray(x, y, fx, fy).at(700.0)).unwrap();
                let expected = [x as f64 - 0.5 + fx, y as f64 - 0.5 + fy];
                assert!((px[0] - expected[0]).abs() < 1e-4 && (px[1] - expected[1]).abs() < 1e-4, "{px:?}");
            }
        }
    }
}
