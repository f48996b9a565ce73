//! The coordinates a color field lives in: a projective frame whose lines of constant (a, b) all meet in one point.
//!
//! Light travels in straight lines, so a point-like source throws the same codeword on every point of a ray of light
//! (up to defocus, which changes slowly along it). In a frame centered on the light, c is therefore detailed across (a,
//! b) and nearly constant along w: board positions far apart supervise the same coefficients, so that the field
//! interpolates between them. In the frame centered on the camera, (a, b) are pixels and w is 1/z: any light can be
//! described there, but positions share no coefficients. Both are this one type with another center. A center at
//! infinity (parallel light) is `kappa = 0`.

use nalgebra::{Matrix3, Point3, Vector3};
use nelu3d_field::lattice::{ProjectiveFrame, ProjectiveLine};
use serde::{Deserialize, Serialize};

/// The point in which the lines of a [`FieldFrame`] meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Center {
    /// The light source, found from the sweep itself (or from a calibrated projector).
    Light,
    /// The camera's center.
    Camera,
}

/// A projective frame over the calibrated volume: camera-frame points (mm) to unit coordinates (a, b, w) in `[0, 1]^3`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldFrame {
    /// A point in the middle of the volume, mm.
    pub origin: [f64; 3],
    /// Unit axes e1, e2 (across) and e3 (along, pointing away from the center), row by row.
    pub axes: [[f64; 3]; 3],
    /// One over the distance from the center to the origin, 1/mm; 0 for parallel lines, negative for converging ones.
    pub kappa: f64,
    /// Lower corner of the box of (a, b, w) that maps to the unit cube, mm.
    pub lo: [f64; 3],
    /// Upper corner, mm.
    pub hi: [f64; 3],
}

/// A point in a [`FieldFrame`] and its derivative along a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointOnRay {
    /// Unit coordinates.
    pub q: [f32; 3],
    /// Derivative of the unit coordinates along the ray, 1/mm.
    pub dq: [f32; 3],
}

impl FieldFrame {
    /// Makes a frame whose lines meet in `center`, with its origin at `origin`; e1 is as close to `right` as it can be.
    /// The box is empty until [`Self::enclose`] has grown it.
    pub fn around(center: Point3<f64>, origin: Point3<f64>, right: Vector3<f64>) -> Self {
        let along = origin - center;
        Self::new(origin, along.normalize(), 1.0 / along.norm(), right)
    }

    /// Makes a frame with the axis `along` (unit) and the inverse distance `kappa` to the point where its lines meet.
    pub fn new(origin: Point3<f64>, along: Vector3<f64>, kappa: f64, right: Vector3<f64>) -> Self {
        let e1 = (right - along * right.dot(&along)).normalize();
        let e2 = along.cross(&e1);
        let axes = [e1, e2, along].map(|e| [e.x, e.y, e.z]);
        let origin = [origin.x, origin.y, origin.z];
        Self { origin, axes, kappa, lo: [f64::INFINITY; 3], hi: [f64::NEG_INFINITY; 3] }
    }

    /// Returns the point in which the lines meet, mm; `None` when they are parallel.
    pub fn center(&self) -> Option<Point3<f64>> {
        let along = Vector3::from(self.axes[2]);
        (self.kappa != 0.0).then(|| Point3::from(self.origin) - along / self.kappa)
    }

    /// Returns the rotation from the camera's axes to the frame's.
    fn rotation(&self) -> Matrix3<f64> {
        Matrix3::from_fn(|r, c| self.axes[r][c])
    }

    /// Returns (a, b, w) of a point, mm; `None` behind the center.
    pub fn to_abw(&self, x: &Point3<f64>) -> Option<[f64; 3]> {
        let y = self.rotation() * (x - Point3::from(self.origin));
        let s = 1.0 + self.kappa * y.z;
        (s > 1e-6).then(|| [y.x / s, y.y / s, y.z / s])
    }

    /// Grows the box so that it holds the point.
    pub fn enclose(&mut self, x: &Point3<f64>) {
        if let Some(p) = self.to_abw(x) {
            for i in 0..3 {
                self.lo[i] = self.lo[i].min(p[i]);
                self.hi[i] = self.hi[i].max(p[i]);
            }
        }
    }

    /// Returns the unit coordinates of a point; `None` behind the center. Inside the box they lie in `[0, 1]^3`.
    pub fn to_unit(&self, x: &Point3<f64>) -> Option<[f32; 3]> {
        let p = self.to_abw(x)?;
        Some(std::array::from_fn(|i| ((p[i] - self.lo[i]) / (self.hi[i] - self.lo[i])) as f32))
    }

    /// Returns the camera-frame point with the given unit coordinates, mm.
    pub fn from_unit(&self, q: [f64; 3]) -> Point3<f64> {
        let p: [f64; 3] = std::array::from_fn(|i| self.lo[i] + q[i] * (self.hi[i] - self.lo[i]));
        let s = 1.0 / (1.0 - self.kappa * p[2]);
        let y = Vector3::new(p[0] * s, p[1] * s, p[2] * s);
        Point3::from(self.origin) + self.rotation().transpose() * y
    }

    /// Returns, row by row, the affine map from points (mm) to the coordinates y that this frame divides by 1 + kappa ·
    /// y_z.
    pub fn affine(&self) -> [[f64; 4]; 3] {
        self.axes.map(|e| {
            let offset = -(e[0] * self.origin[0] + e[1] * self.origin[1] + e[2] * self.origin[2]);
            [e[0], e[1], e[2], offset]
        })
    }

    /// Returns the map from coordinates along this frame's axes to unit coordinates.
    pub fn projective(&self) -> ProjectiveFrame {
        let scale = std::array::from_fn(|i| 1.0 / (self.hi[i] - self.lo[i]));
        ProjectiveFrame { kappa: self.kappa, lo: self.lo, scale }
    }

    /// Returns the line `t ↦ dir · t` of a camera ray through this frame, prepared for evaluation at many `t`.
    pub fn along_ray(&self, dir: &Vector3<f64>) -> RayInFrame {
        let r = self.rotation();
        let center = r * (Point3::origin() - Point3::from(self.origin));
        RayInFrame { center: center.into(), dir: (r * dir).into(), frame: self.projective() }
    }
}

/// A camera ray in the coordinates of a [`FieldFrame`], made by [`FieldFrame::along_ray`].
#[derive(Clone, Copy, Debug)]
pub struct RayInFrame {
    /// The camera's center along the frame's axes, mm: the same for all rays.
    pub center: [f64; 3],
    /// The ray's unit direction along the frame's axes.
    pub dir: [f64; 3],
    /// The map to unit coordinates.
    pub frame: ProjectiveFrame,
}

impl RayInFrame {
    /// Returns the ray by inverse depth: at s lies the point with 1/z = `inv_z` + s · `unit`, 1/mm. `dir_z` is the z
    /// component of the ray's direction in the camera's frame.
    pub fn by_inverse_depth(&self, inv_z: f32, unit: f32, dir_z: f32) -> ProjectiveLine {
        // With v = dir_z / z = 1/t, a point is v · center + direction in homogeneous coordinates, linear in v.
        let (center, dir) = (self.frame.homogeneous(self.center, 1.0), self.frame.homogeneous(self.dir, 0.0));
        let [v, dv] = [inv_z, unit].map(|v| f64::from(v) * f64::from(dir_z));
        ProjectiveLine::new(std::array::from_fn(|i| dir[i] + v * center[i]), center.map(|c| dv * c))
    }

    /// Returns the unit coordinates at distance `t`, mm, and their derivative by `t`.
    pub fn at(&self, t: f64) -> PointOnRay {
        let ProjectiveFrame { kappa, lo, scale } = self.frame;
        let y: [f64; 3] = std::array::from_fn(|i| self.center[i] + t * self.dir[i]);
        let s = 1.0 / (1.0 + kappa * y[2]).max(1e-6);
        let ds = -kappa * self.dir[2] * s * s;
        PointOnRay {
            q: std::array::from_fn(|i| ((y[i] * s - lo[i]) * scale[i]) as f32),
            dq: std::array::from_fn(|i| ((self.dir[i] * s + y[i] * ds) * scale[i]) as f32),
        }
    }
}
