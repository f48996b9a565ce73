//! Pinhole cameras with OpenCV's distortion model, and the calibrated projector, which is one run backwards.

mod distortion;
mod file;

pub use distortion::Distortion;
pub use file::{
    CameraFileError, camera_from_bytes, projector_from_bytes, projector_json, read_camera, read_projector,
    write_camera, write_projector,
};

use nalgebra::{Isometry3, Matrix2x3, Matrix3, Point3, Vector3};

/// A ray in the camera's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts, mm.
    pub origin: Point3<f64>,
    /// Unit direction.
    pub dir: Vector3<f64>,
}

impl Ray {
    /// Returns the point at distance `t` (mm) along the ray.
    pub fn at(&self, t: f64) -> Point3<f64> {
        self.origin + self.dir * t
    }
}

/// Intrinsics of a camera: a pinhole and a lens distortion.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Focal length along x, px.
    pub fx: f64,
    /// Focal length along y, px.
    pub fy: f64,
    /// Principal point, px.
    pub cx: f64,
    /// Principal point, px.
    pub cy: f64,
    /// Lens distortion, OpenCV's model.
    pub distortion: Distortion,
}

impl Camera {
    /// Makes a camera without distortion.
    pub fn pinhole(width: usize, height: usize, fx: f64, fy: f64, cx: f64, cy: f64) -> Self {
        Self { width, height, fx, fy, cx, cy, distortion: Distortion::default() }
    }

    /// Returns pixel coordinates of a point in the camera's frame, or `None` when it lies behind the camera.
    #[inline]
    pub fn project(&self, p: &Point3<f64>) -> Option<[f64; 2]> {
        if p.z <= 1e-9 {
            return None;
        }
        let [x, y] = self.distortion.distort([p.x / p.z, p.y / p.z]);
        Some([self.fx * x + self.cx, self.fy * y + self.cy])
    }

    /// Returns what [`Self::project`] does, and its derivative by the point: a row for each pixel coordinate, px/mm.
    #[inline]
    pub fn project_with_jacobian(&self, p: &Point3<f64>) -> Option<([f64; 2], Matrix2x3<f64>)> {
        let px = self.project(p)?;
        let (x, y, by_z) = (p.x / p.z, p.y / p.z, 1.0 / p.z);
        let j = self.distortion.jacobian([x, y]);
        let row = |f: f64, a: f64, b: f64| [f * a * by_z, f * b * by_z, -f * (a * x + b * y) * by_z];
        let (u, v) = (row(self.fx, j.m11, j.m12), row(self.fy, j.m21, j.m22));
        Some((px, Matrix2x3::new(u[0], u[1], u[2], v[0], v[1], v[2])))
    }

    /// Returns undistorted image-plane coordinates (x/z, y/z) of a pixel.
    pub fn undistort(&self, px: [f64; 2]) -> [f64; 2] {
        self.distortion.undistort([(px[0] - self.cx) / self.fx, (px[1] - self.cy) / self.fy])
    }

    /// Returns the viewing ray of a pixel: through the camera's center, unit direction.
    pub fn ray(&self, px: [f64; 2]) -> Ray {
        let [x, y] = self.undistort(px);
        Ray { origin: Point3::origin(), dir: Vector3::new(x, y, 1.0).normalize() }
    }

    /// Returns the camera whose pixels are `block × block` of this one's, as [`crate::Image::binned`] makes its images.
    pub fn binned(&self, block: usize) -> Self {
        let by = block as f64;
        // The middle of the first pixel is at 0.
        let center = |c: f64| (c + 0.5) / by - 0.5;
        Self {
            width: self.width / block,
            height: self.height / block,
            fx: self.fx / by,
            fy: self.fy / by,
            cx: center(self.cx),
            cy: center(self.cy),
            distortion: self.distortion.clone(),
        }
    }

    /// Returns the camera matrix K.
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(self.fx, 0.0, self.cx, 0.0, self.fy, self.cy, 0.0, 0.0, 1.0)
    }

    /// Returns the number of pixels.
    pub fn n_pixels(&self) -> usize {
        self.width * self.height
    }
}

/// A calibrated projector: intrinsics of its image plane and where it stands. Only decoders that triangulate need one.
#[derive(Clone, Debug, PartialEq)]
pub struct Projector {
    /// Intrinsics of the projected image.
    pub optics: Camera,
    /// Takes camera coordinates to projector coordinates.
    pub proj_from_cam: Isometry3<f64>,
}

impl Projector {
    /// Returns the projector pixel that lights a camera-frame point, or `None` behind the projector.
    pub fn project(&self, p: &Point3<f64>) -> Option<[f64; 2]> {
        self.optics.project(&(self.proj_from_cam * p))
    }

    /// Returns the projector's center in the camera's frame, mm.
    pub fn center(&self) -> Point3<f64> {
        self.proj_from_cam.inverse() * Point3::origin()
    }
}
