//! The camera's rays in the field's coordinates, and the part of each that was calibrated.

use nelu3d_scan::Camera;
use rayon::prelude::*;

use super::field::ColorField;
use super::frame::{FieldFrame, RayInFrame};
use super::validity::{KnownAxes, Validity};

/// The rays of an image in the coordinates of a color field, and the part of each that was calibrated.
pub struct CameraRays {
    /// Focal length, px (mean of x and y).
    pub focal_px: f32,
    /// Undistorted image-plane coordinates (x/z, y/z) per pixel.
    pub plane: Vec<[f32; 2]>,
    /// `[t_near, t_far]` per pixel, mm along the unit ray; empty (near > far) outside the calibrated volume.
    pub range: Vec<[f32; 2]>,
    /// Per pixel, the axes of the code that are known all over its range.
    pub known: Vec<KnownAxes>,
    /// The color field's coordinates.
    pub frame: FieldFrame,
}

impl CameraRays {
    /// Makes the rays of a camera's image reduced by a factor `f`. The camera may see a part of the picture only: from
    /// its column and row `origin` on.
    pub fn new(camera: &Camera, field: &ColorField, f: usize, origin: [usize; 2]) -> Self {
        Self::of_lit(camera, field, f, origin, |_| true)
    }

    /// Makes the rays of a camera's image like [`Self::new`]; ranges only of the pixels that are `lit`, as if no other
    /// pixel's ray was calibrated anywhere.
    pub fn of_lit(
        camera: &Camera,
        field: &ColorField,
        f: usize,
        origin: [usize; 2],
        lit: impl Fn(usize) -> bool + Sync,
    ) -> Self {
        let (w, h) = (camera.width / f, camera.height / f);
        let pixels = (0..w * h).into_par_iter().with_min_len(w.max(1));
        Self::of(camera, field, f, origin, pixels.map(|i| ([i % w, i / w], lit(i))))
    }

    /// Makes the rays of some pixels (x, y) of a camera's image, in their order.
    pub fn of_pixels(camera: &Camera, field: &ColorField, pixels: &[[usize; 2]]) -> Self {
        Self::of(camera, field, 1, [0, 0], pixels.par_iter().map(|px| (*px, true)))
    }

    /// Makes the rays of pixels (x, y) of a reduced image, and the ranges of those for which they are asked.
    fn of(
        camera: &Camera,
        field: &ColorField,
        f: usize,
        origin: [usize; 2],
        pixels: impl IndexedParallelIterator<Item = ([usize; 2], bool)>,
    ) -> Self {
        let half = (f as f64 - 1.0) / 2.0;
        let (plane, (range, known)) = pixels
            .map(|([x, y], ranged)| {
                let (x, y) = (x * f, y * f);
                let plane = camera.undistort([x as f64 + half, y as f64 + half]).map(|v| v as f32);
                let range = ranged.then(|| {
                    let [u, v] = plane.map(f64::from);
                    let ray = field.frame.along_ray(&nalgebra::Vector3::new(u, v, 1.0).normalize());
                    let [x, y] = [x + f / 2 + origin[0], y + f / 2 + origin[1]];
                    field.validity.range_of_ray(x, y, |t| ray.at(f64::from(t)).q)
                });
                (plane, range.flatten().unwrap_or(([1.0, 0.0], KnownAxes::NONE)))
            })
            .unzip();
        let focal_px = (0.5 * (camera.fx + camera.fy)) as f32 / f as f32;
        Self { focal_px, plane, range, known, frame: field.frame }
    }

    /// Returns the z component of pixel `i`'s unit ray: depth = t · z.
    #[inline]
    pub fn dir_z(&self, i: usize) -> f32 {
        let [u, v] = self.plane[i];
        1.0 / (1.0 + u * u + v * v).sqrt()
    }

    /// Returns whether what is known of the codewords of pixel `i` is known at unit coordinates `q`.
    #[inline]
    pub fn is_calibrated(&self, i: usize, q: [f32; 3], validity: &Validity) -> bool {
        !self.known[i].is_none() && validity.known_at(q).covers(self.known[i])
    }

    /// Returns the ray of pixel `i` in the field's frame.
    pub fn in_frame(&self, i: usize) -> RayInFrame {
        self.in_frame_beside(i, [0.0; 2]).0
    }

    /// Returns the ray of a place `shift` pixels beside the middle of pixel `i` in the field's frame, and the z component
    /// of the unit ray.
    pub fn in_frame_beside(&self, i: usize, shift: [f32; 2]) -> (RayInFrame, f32) {
        let [u, v] = [0, 1].map(|axis| f64::from(self.plane[i][axis]) + f64::from(shift[axis] / self.focal_px));
        let dir = nalgebra::Vector3::new(u, v, 1.0).normalize();
        (self.frame.along_ray(&dir), dir.z as f32)
    }
}
