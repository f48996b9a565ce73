//! A smooth map from the board to the image: a plane seen through a lens.

use nalgebra::{DMatrix, DVector};

use super::pair::Pair;
use super::pixels::Pixels;
use crate::Camera;
use crate::camera::Distortion;
use crate::least_squares::{LmSettings, Problem, minimize};
use crate::pose::Homography;
use crate::statistics::median;

/// A homography from the board to the ideal image plane, then the camera's distortion.
#[derive(Clone, Debug)]
pub(super) struct Warp {
    camera: Camera,
    plane_from_board: Homography,
}

impl Warp {
    /// Fits a map to pairs of which almost half may be wrong. Without a camera, a radial distortion about the image's
    /// center is fitted, too.
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

    /// Returns the pixel of a board point.
    pub(super) fn px(&self, board_mm: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.camera.distortion.distort(self.plane_from_board.apply(board_mm));
        [self.camera.fx * x + self.camera.cx, self.camera.fy * y + self.camera.cy]
    }

    /// Adds k1 and k2: a Huber-weighted fit of nine homography entries and two coefficients.
    fn with_radial(self, board: &[[f64; 2]], px: &[[f64; 2]]) -> Self {
        let mut start = [0.0; N];
        let m = &self.plane_from_board.matrix;
        for i in 0..9 {
            start[i] = m[(i / 3, i % 3)];
        }
        let settings = LmSettings { min_damping: 0.0, max_iterations: 40, ..LmSettings::default() };
        let (normal, rhs) = (DMatrix::zeros(N, N), DVector::zeros(N));
        let mut fit = RadialFit { camera: &self.camera, board, px, limit: f64::INFINITY, normal, rhs };
        let found = minimize(&mut fit, start, &settings).unwrap_or(start);
        fit.warp(&found)
    }
}

/// Parameters of a radial fit: nine homography entries, k1 and k2.
const N: usize = 11;

/// The fit of a homography and a radial distortion to board points and their pixels.
struct RadialFit<'a> {
    camera: &'a Camera,
    board: &'a [[f64; 2]],
    px: &'a [[f64; 2]],
    /// Residuals beyond it (px) count less: Huber's weights.
    limit: f64,
    normal: DMatrix<f64>,
    rhs: DVector<f64>,
}

impl RadialFit<'_> {
    fn warp(&self, p: &[f64; N]) -> Warp {
        let matrix = nalgebra::Matrix3::from_row_slice(&p[..9]);
        let distortion = Distortion::new(&[p[9], p[10], 0.0, 0.0]).unwrap_or_default();
        Warp { camera: Camera { distortion, ..self.camera.clone() }, plane_from_board: Homography { matrix } }
    }

    fn residuals(&self, p: &[f64; N]) -> Vec<f64> {
        let warp = self.warp(p);
        let of = |(b, q): (&[f64; 2], &[f64; 2])| {
            let r = warp.px(*b);
            [r[0] - q[0], r[1] - q[1]]
        };
        self.board.iter().zip(self.px).flat_map(of).collect()
    }

    fn huber_cost(&self, r: &[f64]) -> f64 {
        let huber = |n: f64| if n < self.limit { n * n } else { self.limit * (2.0 * n - self.limit) };
        r.chunks_exact(2).map(|r| huber(r[0].hypot(r[1]))).sum()
    }
}

impl Problem for RadialFit<'_> {
    type Parameters = [f64; N];

    fn cost(&mut self, p: &[f64; N]) -> f64 {
        self.huber_cost(&self.residuals(p))
    }

    /// Chooses the weights anew and takes central differences.
    fn linearize(&mut self, p: &[f64; N], _: f64) -> Option<f64> {
        let r = self.residuals(p);
        let norms: Vec<f64> = r.chunks_exact(2).map(|r| r[0].hypot(r[1])).collect();
        let limit = (2.0 * median(&mut norms.clone())?).max(0.02);
        self.limit = limit;
        let weight = |i: usize| if norms[i / 2] > limit { (limit / norms[i / 2]).sqrt() } else { 1.0 };
        let mut j = DMatrix::zeros(r.len(), N);
        for c in 0..N {
            let h = 1e-6 * p[c].abs().max(if c < 9 { 1e-6 } else { 1e-2 });
            let (mut a, mut b) = (*p, *p);
            (a[c], b[c]) = (p[c] + h, p[c] - h);
            let (a, b) = (self.residuals(&a), self.residuals(&b));
            for i in 0..r.len() {
                j[(i, c)] = weight(i) * (a[i] - b[i]) / (2.0 * h);
            }
        }
        self.rhs = -j.transpose() * DVector::from_iterator(r.len(), r.iter().enumerate().map(|(i, r)| weight(i) * r));
        self.normal = j.transpose() * &j;
        Some(self.huber_cost(&r))
    }

    fn step(&mut self, p: &[f64; N], damping: f64) -> Option<[f64; N]> {
        let mut a = self.normal.clone();
        for i in 0..N {
            a[(i, i)] = a[(i, i)] * (1.0 + damping) + 1e-12;
        }
        let step = a.cholesky()?.solve(&self.rhs);
        Some(std::array::from_fn(|i| p[i] + step[i]))
    }

    fn accept(&mut self, before: f64, after: f64) -> bool {
        before - after <= 1e-9 * before
    }
}
