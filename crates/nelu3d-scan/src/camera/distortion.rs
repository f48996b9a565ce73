//! OpenCV's lens distortion with 0, 4, 5, 8, 12 or 14 coefficients: radial (rational), tangential, thin prism, tilt.

use nalgebra::{Matrix2, Matrix3, Rotation3, Vector3};

/// Distortion coefficients in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 τx τy.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Distortion {
    coeffs: [f64; 14],
    n: usize,
}

/// Numbers of coefficients OpenCV knows.
const COUNTS: [usize; 6] = [0, 4, 5, 8, 12, 14];

impl Distortion {
    /// Makes a distortion from OpenCV's list of 0, 4, 5, 8, 12 or 14 finite coefficients; `None` for any other list.
    pub fn new(coeffs: &[f64]) -> Option<Self> {
        if !COUNTS.contains(&coeffs.len()) || coeffs.iter().any(|c| !c.is_finite()) {
            return None;
        }
        let mut all = [0.0; 14];
        all[..coeffs.len()].copy_from_slice(coeffs);
        Some(Self { coeffs: all, n: coeffs.len() })
    }

    /// Returns the coefficients as given.
    pub fn coeffs(&self) -> &[f64] {
        &self.coeffs[..self.n]
    }

    /// Takes ideal image-plane coordinates to distorted ones.
    #[inline]
    pub fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3, ..] = self.coeffs;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let tangential = [2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y];
        // As most lenses are; called for every sample of every image.
        if self.n <= 5 {
            return [x * radial + tangential[0], y * radial + tangential[1]];
        }
        self.distort_further([x, y], radial, tangential)
    }

    /// Returns what [`Self::distort`] does for more than five coefficients, from the polynomial of the first three
    /// radial ones and the tangential shift.
    fn distort_further(&self, [x, y]: [f64; 2], radial: f64, tangential: [f64; 2]) -> [f64; 2] {
        let [.., k4, k5, k6, s1, s2, s3, s4, tx, ty] = self.coeffs;
        let r2 = x * x + y * y;
        let radial = radial / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
        let xd = x * radial + tangential[0] + r2 * (s1 + r2 * s2);
        let yd = y * radial + tangential[1] + r2 * (s3 + r2 * s4);
        if tx == 0.0 && ty == 0.0 {
            return [xd, yd];
        }
        let v = tilt(tx, ty) * Vector3::new(xd, yd, 1.0);
        [v.x / v.z, v.y / v.z]
    }

    /// Returns the derivatives of [`Self::distort`]: a row for each of its values, a column for x and one for y.
    #[inline]
    pub fn jacobian(&self, [x, y]: [f64; 2]) -> Matrix2<f64> {
        let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tx, ty] = self.coeffs;
        let r2 = x * x + y * y;
        let (above, below) = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
        let (d_above, d_below) = (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3), k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6));
        let radial = above / below;
        // By r², which grows by 2 x and 2 y.
        let d_radial = (d_above - radial * d_below) / below;
        let [d_x, d_y] = [x * d_radial + s1 + 2.0 * s2 * r2, y * d_radial + s3 + 2.0 * s4 * r2];
        let j = Matrix2::new(
            radial + 2.0 * (x * d_x + p1 * y + 3.0 * p2 * x),
            2.0 * (y * d_x + p1 * x + p2 * y),
            2.0 * (x * d_y + p1 * x + p2 * y),
            radial + 2.0 * (y * d_y + 3.0 * p1 * y + p2 * x),
        );
        if tx == 0.0 && ty == 0.0 {
            return j;
        }
        let untilted = self.without_tilt().distort([x, y]);
        let t = tilt(tx, ty);
        let v = t * Vector3::new(untilted[0], untilted[1], 1.0);
        let d_v = t.fixed_columns::<2>(0) * j;
        let d_ratio = |row: usize| (d_v.row(row) * v.z - d_v.row(2) * v[row]) / (v.z * v.z);
        Matrix2::from_rows(&[d_ratio(0), d_ratio(1)])
    }

    /// Returns the lens before a sensor that is not tilted.
    fn without_tilt(&self) -> Self {
        let mut coeffs = self.coeffs;
        coeffs[12..].fill(0.0);
        Self { coeffs, n: self.n.min(12) }
    }

    /// Takes distorted image-plane coordinates to ideal ones: Newton's method on [`Self::distort`], started at the
    /// input.
    pub fn undistort(&self, d: [f64; 2]) -> [f64; 2] {
        if self.n == 0 {
            return d;
        }
        let mut p = d;
        for _ in 0..20 {
            let f = self.distort(p);
            let r = [f[0] - d[0], f[1] - d[1]];
            if r[0].abs().max(r[1].abs()) < 1e-13 {
                break;
            }
            let j = self.jacobian(p);
            let det = j.m11 * j.m22 - j.m12 * j.m21;
            if det.abs() < 1e-9 {
                break;
            }
            p = [p[0] - (j.m22 * r[0] - j.m12 * r[1]) / det, p[1] - (j.m11 * r[1] - j.m21 * r[0]) / det];
        }
        p
    }
}

/// Returns OpenCV's tilted-sensor homography (Scheimpflug): `R = Ry(τy) Rx(τx)` with its own sign convention.
fn tilt(tx: f64, ty: f64) -> Matrix3<f64> {
    // OpenCV's Rx and Ry are the transposes of the usual active rotations.
    let rx = Rotation3::from_axis_angle(&Vector3::x_axis(), -tx);
    let ry = Rotation3::from_axis_angle(&Vector3::y_axis(), -ty);
    let r = (ry * rx).into_inner();
    Matrix3::new(r[(2, 2)], 0.0, -r[(0, 2)], 0.0, r[(2, 2)], -r[(1, 2)], 0.0, 0.0, 1.0) * r
}
