//! The color field along camera rays: what every inner loop of the reconstruction evaluates.

use nelu3d_field::lattice::{Lattice, LatticeEvaluator};
use nelu3d_scan::Camera;
use rayon::prelude::*;

use crate::color_field::ColorField;
use crate::color_field::frame::{Frame, RayInFrame};
use crate::color_field::grid::Grid;

/// Rays of an image, and where along them the field holds.
pub struct Rays {
    /// Focal length, px (mean of x and y).
    pub focal_px: f32,
    /// Undistorted image-plane coordinates (x/z, y/z) per pixel.
    pub plane: Vec<[f32; 2]>,
    /// `[t_near, t_far]` per pixel, mm along the unit ray; empty (near > far) outside the calibrated volume.
    pub range: Vec<[f32; 2]>,
    frame: Frame,
}

impl Rays {
    /// Rays of a camera's image reduced by `f`.
    pub fn new(camera: &Camera, field: &ColorField, f: usize) -> Self {
        let (w, h) = (camera.width / f, camera.height / f);
        let half = (f as f64 - 1.0) / 2.0;
        let (plane, range) = (0..w * h)
            .into_par_iter()
            .map(|i| {
                let (x, y) = ((i % w) * f, (i / w) * f);
                let plane = camera.undistort([x as f64 + half, y as f64 + half]).map(|v| v as f32);
                (plane, field.validity.range(x + f / 2, y + f / 2).unwrap_or([1.0, 0.0]))
            })
            .unzip();
        let focal_px = (0.5 * (camera.fx + camera.fy)) as f32 / f as f32;
        Self { focal_px, plane, range, frame: field.frame }
    }

    /// Rays of a camera without a field.
    #[cfg(test)]
    pub(super) fn for_test(focal_px: f32, plane: Vec<[f32; 2]>) -> Self {
        let right = nalgebra::Vector3::x();
        let frame = Frame::around(nalgebra::Point3::origin(), nalgebra::Point3::new(0.0, 0.0, 500.0), right);
        Self { focal_px, range: vec![[0.0, 1e9]; plane.len()], plane, frame }
    }

    /// Rays of a field without a camera.
    #[cfg(test)]
    pub(super) fn of_field(focal_px: f32, plane: Vec<[f32; 2]>, range: Vec<[f32; 2]>, frame: Frame) -> Self {
        Self { focal_px, plane, range, frame }
    }

    /// The unit ray's z: depth = t · z.
    #[inline]
    pub fn dir_z(&self, i: usize) -> f32 {
        let [u, v] = self.plane[i];
        1.0 / (1.0 + u * u + v * v).sqrt()
    }

    /// The ray of pixel `i` in the field's frame.
    pub fn in_frame(&self, i: usize) -> RayInFrame {
        let [u, v] = self.plane[i].map(f64::from);
        self.frame.along_ray(&nalgebra::Vector3::new(u, v, 1.0).normalize())
    }
}

/// The color field's spline, ready to be evaluated at many points, and how fine it is.
pub struct Lookup<'a> {
    spline: LatticeEvaluator<'a>,
    /// Cells per pixel.
    fineness: f32,
}

impl<'a> Lookup<'a> {
    /// For the given spline of a field with `fineness` cells per pixel across.
    pub fn new(grid: &'a Grid, fineness: usize) -> Self {
        Self { spline: LatticeEvaluator::new(grid.lattice()), fineness: fineness as f32 }
    }

    /// Channels.
    pub fn k(&self) -> usize {
        self.lattice().k
    }

    /// The spline itself.
    pub(super) fn lattice(&self) -> Lattice<'a> {
        self.spline.lattice()
    }

    /// Pixels across the field along a and b: what disparities are measured in, however fine its cells are.
    pub fn pixels(&self) -> [f32; 2] {
        [0, 1].map(|i| self.lattice().cells[i] as f32 / self.fineness)
    }

    /// c at unit coordinates `q` (clamped to the cube), into `out` (k values).
    #[inline]
    pub fn eval(&self, q: [f32; 3], out: &mut [f32]) {
        self.spline.eval(q, out);
    }

    /// c and its derivative in the direction `dq`, into `out` and `dout` (k values each).
    #[inline]
    pub fn eval_along(&self, q: [f32; 3], dq: [f32; 3], out: &mut [f32], dout: &mut [f32]) {
        self.spline.eval_along(q, dq, out, dout);
    }
}
