//! What is fitted: the camera, the board, the stage, and the poses.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

use crate::camera::{Camera, Distortion};

/// A parameter that all images share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shared {
    /// Focal lengths and principal point: fx, fy, cx, cy, px.
    Pinhole(usize),
    /// A coefficient of the distortion, in OpenCV's order.
    Coefficient(usize),
    /// How the board is bent: coefficients of u², uv, v² in its depth, mm, with u and v from −1 to 1.
    Bend(usize),
    /// Natural logarithm of the board's size over the one described.
    LogScale,
    /// Where the stage's line begins, camera's frame, mm.
    Origin(usize),
    /// A step of the stage, camera's frame, mm.
    Step(usize),
}

/// Values of all parameters.
#[derive(Clone, Debug)]
pub(super) struct Parameters {
    pub(super) camera: Camera,
    pub(super) bend_mm: [f64; 3],
    pub(super) log_scale: f64,
    pub(super) origin: Vector3<f64>,
    pub(super) step: Vector3<f64>,
    /// A pose of the board for each image.
    pub(super) poses: Vec<Isometry3<f64>>,
}

/// The middle of the corners on the board and half their larger extent, mm: the unit of its bend.
#[derive(Clone, Copy, Debug)]
pub(super) struct Middle {
    pub(super) at: [f64; 2],
    pub(super) radius: f64,
}

impl Parameters {
    /// Starts with a camera and poses; nothing is bent or stretched.
    pub(super) fn new(camera: Camera, poses: Vec<Isometry3<f64>>) -> Self {
        let (origin, step) = (Vector3::zeros(), Vector3::zeros());
        Self { camera, bend_mm: [0.0; 3], log_scale: 0.0, origin, step, poses }
    }

    /// Returns the place of a board point in the board's frame, and its coordinates in units of the bend.
    pub(super) fn on_board(&self, [x, y]: [f64; 2], middle: &Middle) -> (Point3<f64>, [f64; 2]) {
        let [u, v] = [(x - middle.at[0]) / middle.radius, (y - middle.at[1]) / middle.radius];
        let depth = self.bend_mm[0] * u * u + self.bend_mm[1] * u * v + self.bend_mm[2] * v * v;
        let s = self.log_scale.exp();
        (Point3::new(s * x, s * y, s * depth), [u, v])
    }

    /// Returns the parameters after a step of the shared ones and of every pose.
    pub(super) fn after(&self, free: &[Shared], shared: &[f64], poses: &[Vector6<f64>]) -> Self {
        let mut next = self.clone();
        let mut k = self.coefficients();
        for (which, d) in free.iter().zip(shared) {
            match *which {
                Shared::Pinhole(0) => next.camera.fx += d,
                Shared::Pinhole(1) => next.camera.fy += d,
                Shared::Pinhole(2) => next.camera.cx += d,
                Shared::Pinhole(_) => next.camera.cy += d,
                Shared::Coefficient(i) => k[i] += d,
                Shared::Bend(i) => next.bend_mm[i] += d,
                Shared::LogScale => next.log_scale += d,
                Shared::Origin(i) => next.origin[i] += d,
                Shared::Step(i) => next.step[i] += d,
            }
        }
        let n = self.camera.distortion.coeffs().len();
        // An overflow is no camera: its cost is infinite.
        next.camera.distortion = Distortion::new(&k[..n]).unwrap_or_default();
        if k[..n].iter().any(|c| !c.is_finite()) {
            next.camera.fx = f64::NAN;
        }
        for (pose, d) in next.poses.iter_mut().zip(poses) {
            let turn = UnitQuaternion::from_scaled_axis(d.fixed_rows::<3>(0).into_owned());
            let shift = pose.translation.vector + d.fixed_rows::<3>(3);
            *pose = Isometry3::from_parts(Translation3::from(shift), turn * pose.rotation);
        }
        next
    }

    /// Returns the distortion's first eight coefficients; what it does not have is 0.
    pub(super) fn coefficients(&self) -> [f64; 8] {
        let mut k = [0.0; 8];
        for (a, b) in k.iter_mut().zip(self.camera.distortion.coeffs()) {
            *a = *b;
        }
        k
    }
}

/// Returns the derivative of a distorted point of the image plane by the first eight coefficients, at an ideal point.
pub(super) fn by_coefficients(k: &[f64; 8], [x, y]: [f64; 2]) -> [[f64; 2]; 8] {
    let [k1, k2, _, _, k3, k4, k5, k6] = *k;
    let r2 = x * x + y * y;
    let powers = [r2, r2 * r2, r2 * r2 * r2];
    let above = 1.0 + k1 * powers[0] + k2 * powers[1] + k3 * powers[2];
    let below = 1.0 + k4 * powers[0] + k5 * powers[1] + k6 * powers[2];
    let up = powers.map(|p| [x * p / below, y * p / below]);
    let down = powers.map(|p| [-x * above * p / (below * below), -y * above * p / (below * below)]);
    let p1 = [2.0 * x * y, r2 + 2.0 * y * y];
    let p2 = [r2 + 2.0 * x * x, 2.0 * x * y];
    [up[0], up[1], p1, p2, up[2], down[0], down[1], down[2]]
}
