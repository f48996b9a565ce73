//! A smooth map from the board to the image: a plane seen through a lens.

use nalgebra::{DMatrix, DVector};

use super::Pair;
use super::refine::Pixels;
use crate::Camera;
use crate::camera::Distortion;
use crate::pose::Homography;

/// A homography from the board to the ideal image plane, then the camera's distortion.
#[derive(Clone, Debug)]
pub(super) struct Warp {
    camera: Camera,
    plane_from_board: Homography,
}

impl Warp {
    /// Fitted to pairs of which almost half may be wrong. Without a camera, a radial distortion about the image's center
    /// is fitted, too.
    pub(super) fn fit(pairs: &[Pair], camera: Option<&Camera>, image: &Pixels) -> Option<Self> {
        let (board, px): (Vec<_>, Vec<_>) = pairs.iter().copied().unzip();
        if let Some(camera) = camera {
            let plane: Vec<_> = px.iter().map(|p| camera.undistort(*p)).collect();
            let plane_from_board = Homography::robust(&board, &plane)?;
            return Some(Self { camera: camera.clone(), plane_from_board });
        }
        let (w, h) = (image.width as f64, image.height as f64);
        let f = w.max(h);
        let camera = Camera::pinhole(image.width, image.height, f, f, 0.5 * (w - 1.0), 0.5 * (h - 1.0));
        let plane: Vec<_> = px.iter().map(|p| camera.undistort(*p)).collect();
        let start = Homography::robust(&board, &plane)?;
        let straight = Self { camera, plane_from_board: start };
        // Ten parameters; with less than twice as many coordinates to spare the fit would bend to errors.
        Some(if pairs.len() >= 16 { straight.with_radial(&board, &px) } else { straight })
    }

    /// The pixel of a board point.
    pub(super) fn px(&self, board_mm: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.camera.distortion.distort(self.plane_from_board.apply(board_mm));
        [self.camera.fx * x + self.camera.cx, self.camera.fy * y + self.camera.cy]
    }

    /// Adds k1 and k2: Levenberg–Marquardt on nine homography entries and two coefficients, Huber-weighted.
    fn with_radial(self, board: &[[f64; 2]], px: &[[f64; 2]]) -> Self {
        const N: usize = 11;
        let build = |p: &[f64; N]| -> Self {
            let matrix = nalgebra::Matrix3::from_row_slice(&p[..9]);
            let distortion = Distortion::new(&[p[9], p[10], 0.0, 0.0]).unwrap_or_default();
            Self { camera: Camera { distortion, ..self.camera.clone() }, plane_from_board: Homography { matrix } }
        };
        let residuals = |p: &[f64; N]| -> Vec<f64> {
            let warp = build(p);
            let of = |(b, q): (&[f64; 2], &[f64; 2])| {
                let r = warp.px(*b);
                [r[0] - q[0], r[1] - q[1]]
            };
            board.iter().zip(px).flat_map(of).collect()
        };
        let cost = |r: &[f64], limit: f64| -> f64 {
            let huber = |n: f64| if n < limit { n * n } else { limit * (2.0 * n - limit) };
            r.chunks_exact(2).map(|r| huber(r[0].hypot(r[1]))).sum()
        };
        let mut p = [0.0; N];
        let m = &self.plane_from_board.matrix;
        for i in 0..9 {
            p[i] = m[(i / 3, i % 3)];
        }
        let mut damping = 1e-4;
        for _ in 0..40 {
            let r = residuals(&p);
            let norms: Vec<f64> = r.chunks_exact(2).map(|r| r[0].hypot(r[1])).collect();
            let mut sorted = norms.clone();
            sorted.sort_by(f64::total_cmp);
            let limit = (2.0 * sorted[sorted.len() / 2]).max(0.02);
            let weight = |i: usize| if norms[i / 2] > limit { (limit / norms[i / 2]).sqrt() } else { 1.0 };
            let mut j = DMatrix::zeros(r.len(), N);
            for c in 0..N {
                let h = 1e-6 * p[c].abs().max(if c < 9 { 1e-6 } else { 1e-2 });
                let (mut a, mut b) = (p, p);
                (a[c], b[c]) = (p[c] + h, p[c] - h);
                let (a, b) = (residuals(&a), residuals(&b));
                for i in 0..r.len() {
                    j[(i, c)] = weight(i) * (a[i] - b[i]) / (2.0 * h);
                }
            }
            let rhs =
                -j.transpose() * DVector::from_iterator(r.len(), r.iter().enumerate().map(|(i, r)| weight(i) * r));
            let normal = j.transpose() * &j;
            let now = cost(&r, limit);
            let mut gained = 0.0;
            while damping < 1e8 {
                let mut a = normal.clone();
                for i in 0..N {
                    a[(i, i)] = a[(i, i)] * (1.0 + damping) + 1e-12;
                }
                let Some(step) = a.cholesky().map(|c| c.solve(&rhs)) else {
                    damping *= 10.0;
                    continue;
                };
                let next: [f64; N] = std::array::from_fn(|i| p[i] + step[i]);
                let c = cost(&residuals(&next), limit);
                if c < now {
                    (gained, p) = (now - c, next);
                    damping *= 0.1;
                    break;
                }
                damping *= 10.0;
            }
            if gained <= 1e-9 * now {
                break;
            }
        }
        build(&p)
    }
}
