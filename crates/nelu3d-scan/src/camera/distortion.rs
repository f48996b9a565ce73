//! OpenCV's lens distortion with 0, 4, 5, 8, 12 or 14 coefficients: radial (rational), tangential, thin prism, tilt.

use nalgebra::{Matrix3, Rotation3, Vector3};

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
    pub fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tx, ty] = self.coeffs;
        let r2 = x * x + y * y;
        let radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
        let xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2);
        let yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + r2 * s4);
        if tx == 0.0 && ty == 0.0 {
            return [xd, yd];
        }
        let v = tilt(tx, ty) * Vector3::new(xd, yd, 1.0);
        [v.x / v.z, v.y / v.z]
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
            let h = 1e-6;
            let fx = self.distort([p[0] + h, p[1]]);
            let fy = self.distort([p[0], p[1] + h]);
            let (a, c) = ((fx[0] - f[0]) / h, (fx[1] - f[1]) / h);
            let (b, e) = ((fy[0] - f[0]) / h, (fy[1] - f[1]) / h);
            let det = a * e - b * c;
            if det.abs() < 1e-9 {
                break;
            }
            p = [p[0] - (e * r[0] - b * r[1]) / det, p[1] - (a * r[1] - c * r[0]) / det];
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn undistort_inverts_distort() {
        let lists: [&[f64]; 6] = [
            &[],
            &[-0.1, 0.05, 1e-3, -2e-3],
            &[-0.081, 0.062, 0.0006, -0.0009, 0.01],
            &[-0.2, 0.1, 1e-3, 1e-3, 0.02, 0.01, -0.02, 0.01],
            &[-0.2, 0.1, 1e-3, 1e-3, 0.02, 0.01, -0.02, 0.01, 1e-3, -2e-3, 1e-3, 1e-3],
            &[-0.2, 0.1, 1e-3, 1e-3, 0.02, 0.01, -0.02, 0.01, 1e-3, -2e-3, 1e-3, 1e-3, 0.02, -0.03],
        ];
        for coeffs in lists {
            let d = Distortion::new(coeffs).unwrap();
            for i in -4..=4 {
                for j in -4..=4 {
                    let p = [i as f64 * 0.08, j as f64 * 0.07];
                    let q = d.undistort(d.distort(p));
                    assert!((p[0] - q[0]).abs() < 1e-11 && (p[1] - q[1]).abs() < 1e-11, "{coeffs:?} at {p:?}");
                }
            }
        }
    }

    #[test]
    fn other_counts_and_nan_are_refused() {
        assert!(Distortion::new(&[0.1]).is_none());
        assert!(Distortion::new(&[0.1, f64::NAN, 0.0, 0.0]).is_none());
    }
}
