//! The bundle adjustment: camera, board, stage, and poses at once (Triggs et al. 2000), by Levenberg–Marquardt, with the
//! poses eliminated from the normal equations (Schur complement), which are independent of each other.

use nalgebra::{DMatrix, DVector, Matrix6, Point3, Vector3, Vector6};

use super::options::StageStep;
use super::parameters::{Middle, Parameters, Shared, by_coefficients};
use super::view::View;
use crate::board::Corner;
use crate::least_squares::{LmSettings, Problem, minimize};
use crate::pose::{huber, sigma_of_norms};

/// Residual norms beyond this many σ are outliers; of good corners, 4e-5 are.
const REJECT_SIGMAS: f64 = 4.5;
/// No corner is better known than this, px: keeps the statistics of noise-free input finite.
const SIGMA_FLOOR_PX: f64 = 1e-4;
/// Standard deviation of a board's size over the one described, where a stage tells the scale: a ruler of 100 mm, read to
/// 0.2 mm.
const SCALE_SIGMA: f64 = 0.002;
/// The step of a stage is as given, to this part of it.
const STEP_SIGMA: f64 = 1e-6;

/// A fit of some parameters to some images.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    pub(super) parameters: Parameters,
    /// The shared parameters that were fitted.
    pub(super) free: Vec<Shared>,
    /// For each image and corner, whether it was used.
    pub(super) used: Vec<Vec<bool>>,
    /// Robust standard deviation of a corner's coordinate, px.
    pub(super) sigma_px: f64,
    /// Covariance of the shared parameters as independent corners give it, and as images do whose corners share their
    /// errors; `None` where they are not determined.
    pub(super) covariance: Option<DMatrix<f64>>,
}

/// What is fitted to.
pub(super) struct Data<'a> {
    pub(super) views: &'a [&'a View],
    pub(super) middle: Middle,
    pub(super) stage: Option<StageStep>,
}

impl Data<'_> {
    /// Fits the parameters `free` and all poses: Huber's weights at first, then least squares over the corners within
    /// 4.5 robust σ. `None` where no camera explains the corners.
    pub(super) fn fit(&self, start: Parameters, free: &[Shared]) -> Option<Fit> {
        let mut parameters = start;
        let mut sigma_px = sigma_of_norms(&self.norms(&parameters).concat()).max(SIGMA_FLOOR_PX);
        for _ in 0..3 {
            let weigh = |r: &f64| huber(*r, 2.0 * sigma_px);
            let weights = self.norms(&parameters).iter().map(|v| v.iter().map(weigh).collect()).collect();
            parameters = self.minimize(parameters, free, weights, sigma_px)?;
            sigma_px = sigma_of_norms(&self.norms(&parameters).concat()).max(SIGMA_FLOOR_PX);
        }
        let mut used: Vec<Vec<bool>> = Vec::new();
        for _ in 0..2 {
            let limit = REJECT_SIGMAS * sigma_px;
            used = self.norms(&parameters).iter().map(|v| v.iter().map(|r| *r <= limit).collect()).collect();
            let weights = used.iter().map(|v| v.iter().map(|&u| f64::from(u8::from(u))).collect()).collect();
            parameters = self.minimize(parameters, free, weights, sigma_px)?;
            sigma_px = sigma_of_norms(&self.norms(&parameters).concat()).max(SIGMA_FLOOR_PX);
        }
        let covariance = self.covariance(&parameters, free, &used);
        Some(Fit { parameters, free: free.to_vec(), used, sigma_px, covariance })
    }

    fn minimize(
        &self,
        start: Parameters,
        free: &[Shared],
        weights: Vec<Vec<f64>>,
        sigma_px: f64,
    ) -> Option<Parameters> {
        let settings = LmSettings { damping: 1e-4, max_iterations: 60, max_total_trials: 200, ..LmSettings::default() };
        minimize(&mut Bundle { data: self, free, weights, sigma_px, normal: Normal::default() }, start, &settings)
    }

    /// Returns the distances between seen and projected corners, px; infinite behind the camera.
    pub(super) fn norms(&self, p: &Parameters) -> Vec<Vec<f64>> {
        let of = |(view, i): (&&View, usize)| {
            let norm = |c: &Corner| self.residual(p, i, c).map_or(f64::INFINITY, |r| r[0].hypot(r[1]));
            view.corners.iter().map(norm).collect()
        };
        self.views.iter().zip(0..).map(of).collect()
    }

    /// Returns where a corner was seen against where it is projected to, px; `None` behind the camera.
    pub(super) fn residual(&self, p: &Parameters, i: usize, c: &Corner) -> Option<[f64; 2]> {
        let at = p.poses[i] * p.on_board(c.board_mm, &self.middle).0;
        let px = p.camera.project(&at)?;
        Some([c.px[0] - px[0], c.px[1] - px[1]])
    }

    /// Returns by how much the middle of the board misses the stage's line, mm.
    fn off_line(&self, p: &Parameters, i: usize) -> Vector3<f64> {
        let at = p.poses[i] * p.on_board(self.middle.at, &self.middle).0;
        p.origin + self.views[i].number as f64 * p.step - at.coords
    }

    /// Returns the derivative of a corner's pixel by the free shared parameters and by the pose, and its residual.
    fn rows(&self, p: &Parameters, free: &[Shared], i: usize, c: &Corner) -> Option<[Row; 2]> {
        let (board, [u, v]) = p.on_board(c.board_mm, &self.middle);
        let arm = p.poses[i].rotation * board.coords;
        let at: Point3<f64> = (arm + p.poses[i].translation.vector).into();
        let (px, j) = p.camera.project_with_jacobian(&at)?;
        let ideal = [at.x / at.z, at.y / at.z];
        let plane = p.camera.distortion.distort(ideal);
        let by_k = by_coefficients(&p.coefficients(), ideal);
        let focal = [p.camera.fx, p.camera.fy];
        let normal = p.poses[i].rotation * Vector3::z();
        Some([0, 1].map(|k| {
            let jp = Vector3::new(j[(k, 0)], j[(k, 1)], j[(k, 2)]);
            let by_turn = arm.cross(&jp);
            let shared = free.iter().map(|which| match *which {
                Shared::Pinhole(n) if n == k => plane[k],
                Shared::Pinhole(n) if n == k + 2 => 1.0,
                Shared::Coefficient(n) => focal[k] * by_k[n][k],
                Shared::Bend(n) => p.log_scale.exp() * jp.dot(&normal) * [u * u, u * v, v * v][n],
                Shared::LogScale => jp.dot(&arm),
                _ => 0.0,
            });
            Row {
                shared: DVector::from_iterator(free.len(), shared),
                pose: Vector6::new(by_turn.x, by_turn.y, by_turn.z, jp.x, jp.y, jp.z),
                residual: c.px[k] - px[k],
            }
        }))
    }

    /// Returns the derivative of the miss of the stage's line, along each axis, and its residual: rows that a corner's
    /// row resembles.
    fn line_rows(&self, p: &Parameters, free: &[Shared], i: usize) -> [Row; 3] {
        let arm = p.poses[i].rotation * p.on_board(self.middle.at, &self.middle).0.coords;
        let off = self.off_line(p, i);
        let number = self.views[i].number as f64;
        std::array::from_fn(|k| {
            let unit = Vector3::from_fn(|r, _| f64::from(u8::from(r == k)));
            let by_turn = arm.cross(&unit);
            // The place of the board, less that on the line.
            let shared = free.iter().map(|which| match *which {
                Shared::LogScale => arm[k],
                Shared::Origin(n) if n == k => -1.0,
                Shared::Step(n) if n == k => -number,
                _ => 0.0,
            });
            Row {
                shared: DVector::from_iterator(free.len(), shared),
                pose: Vector6::new(by_turn.x, by_turn.y, by_turn.z, unit.x, unit.y, unit.z),
                residual: off[k],
            }
        })
    }

    /// Returns the cost of what is known beside the corners, in units of σ².
    fn prior(&self, p: &Parameters) -> f64 {
        let Some(stage) = self.stage else { return 0.0 };
        let line: f64 = (0..p.poses.len()).map(|i| self.off_line(p, i).norm_squared()).sum();
        line / stage.sigma_mm.powi(2)
            + ((p.step.norm() - stage.step_mm) / (STEP_SIGMA * stage.step_mm)).powi(2)
            + (p.log_scale / SCALE_SIGMA).powi(2)
    }

    /// Builds the normal equations, in units of σ.
    fn normal(&self, p: &Parameters, free: &[Shared], weights: &[Vec<f64>], sigma_px: f64) -> Option<Normal> {
        let g = free.len();
        let mut normal = Normal { shared: DMatrix::zeros(g, g), rhs: DVector::zeros(g), views: Vec::new() };
        for (i, view) in self.views.iter().enumerate() {
            let mut own = ViewNormal::new(g);
            for (c, &w) in view.corners.iter().zip(&weights[i]).filter(|(_, w)| **w > 0.0) {
                for row in self.rows(p, free, i, c)? {
                    own.add(&row, w / (sigma_px * sigma_px));
                }
            }
            normal.shared += &own.corners;
            normal.rhs += &own.gradient;
            if let Some(stage) = self.stage {
                for row in self.line_rows(p, free, i) {
                    let w = stage.sigma_mm.powi(-2);
                    own.add_pose(&row, w);
                    normal.shared += w * &row.shared * row.shared.transpose();
                    normal.rhs += w * row.residual * &row.shared;
                }
            }
            normal.views.push(own);
        }
        if let Some(stage) = self.stage {
            let length = p.step.norm();
            let known = |which: &Shared| match *which {
                Shared::Step(n) => p.step[n] / length.max(1e-12),
                _ => 0.0,
            };
            let row = DVector::from_iterator(g, free.iter().map(known));
            let w = (STEP_SIGMA * stage.step_mm).powi(-2);
            normal.shared += w * &row * row.transpose();
            normal.rhs += w * (stage.step_mm - length) * &row;
            if let Some(k) = free.iter().position(|f| *f == Shared::LogScale) {
                normal.shared[(k, k)] += SCALE_SIGMA.powi(-2);
                normal.rhs[k] -= p.log_scale * SCALE_SIGMA.powi(-2);
            }
        }
        Some(normal)
    }

    /// Returns the covariance of the shared parameters: the inverse of their Schur complement, at the standard deviation
    /// that the residuals have; and where it is larger, the one that does not take corners of an image for independent
    /// (Liang & Zeger 1986): boards are not perfect, nor is the light even.
    fn covariance(&self, p: &Parameters, free: &[Shared], used: &[Vec<bool>]) -> Option<DMatrix<f64>> {
        let g = free.len();
        if g == 0 {
            return None;
        }
        let weights: Vec<Vec<f64>> = used.iter().map(|v| v.iter().map(|&u| f64::from(u8::from(u))).collect()).collect();
        let norms = self.norms(p);
        let (mut sum, mut n) = (0.0, 0.0);
        for (r, w) in norms.iter().flatten().zip(weights.iter().flatten()).filter(|(_, w)| **w > 0.0) {
            (sum, n) = (sum + w * r * r, n + 2.0);
        }
        let unknowns = (g + 6 * self.views.len()) as f64;
        let sigma = (sum / f64::max(n - unknowns, 1.0)).sqrt().max(SIGMA_FLOOR_PX);
        let normal = self.normal(p, free, &weights, sigma)?;
        let inverse = normal.schur(0.0)?.0.try_inverse()?;
        let views = self.views.len() as f64;
        let mut scatter = DMatrix::zeros(g, g);
        for v in &normal.views {
            scatter += &v.gradient * v.gradient.transpose();
        }
        let few = views / f64::max(views - g as f64, 1.0);
        let clustered = &inverse * scatter * &inverse * few;
        // The larger one of each parameter, with the correlations of the first. Fewer images than parameters do not have
        // a scatter of their own.
        let grow = |k: usize| {
            let ratio: f64 = if views > g as f64 { clustered[(k, k)] / inverse[(k, k)] } else { 1.0 };
            ratio.max(1.0).sqrt()
        };
        let grown = DMatrix::from_fn(g, g, |r, c| inverse[(r, c)] * grow(r) * grow(c));
        grown.iter().all(|v| v.is_finite()).then_some(grown)
    }
}

/// The derivative of one residual.
struct Row {
    shared: DVector<f64>,
    pose: Vector6<f64>,
    residual: f64,
}

/// Normal equations, one block of shared parameters and one per image.
#[derive(Default)]
struct Normal {
    shared: DMatrix<f64>,
    rhs: DVector<f64>,
    views: Vec<ViewNormal>,
}

struct ViewNormal {
    /// Of the shared parameters, from this image's corners.
    corners: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Shared parameters by pose.
    mixed: DMatrix<f64>,
    pose: Matrix6<f64>,
    rhs: Vector6<f64>,
}

impl ViewNormal {
    fn new(g: usize) -> Self {
        Self {
            corners: DMatrix::zeros(g, g),
            gradient: DVector::zeros(g),
            mixed: DMatrix::zeros(g, 6),
            pose: Matrix6::zeros(),
            rhs: Vector6::zeros(),
        }
    }

    fn add(&mut self, row: &Row, w: f64) {
        self.corners.ger(w, &row.shared, &row.shared, 1.0);
        self.gradient.axpy(w * row.residual, &row.shared, 1.0);
        self.add_pose(row, w);
    }

    fn add_pose(&mut self, row: &Row, w: f64) {
        self.mixed.ger(w, &row.shared, &row.pose, 1.0);
        self.pose.ger(w, &row.pose, &row.pose, 1.0);
        self.rhs.axpy(w * row.residual, &row.pose, 1.0);
    }
}

/// The normal equations of the shared parameters alone, their right side, and the inverse of every pose's block.
type Reduced = (DMatrix<f64>, DVector<f64>, Vec<Matrix6<f64>>);

impl Normal {
    /// Eliminates the poses; returns what is left for the shared parameters, and the inverse of every pose's block.
    fn schur(&self, damping: f64) -> Option<Reduced> {
        let (mut left, mut rhs) = (self.shared.clone(), self.rhs.clone());
        for k in 0..left.nrows() {
            left[(k, k)] *= 1.0 + damping;
        }
        let mut inverses = Vec::with_capacity(self.views.len());
        for v in &self.views {
            let mut block = v.pose;
            for k in 0..6 {
                block[(k, k)] *= 1.0 + damping;
            }
            let inverse = block.cholesky()?.inverse();
            if !rhs.is_empty() {
                let weighted = &v.mixed * inverse;
                left -= &weighted * v.mixed.transpose();
                rhs -= &weighted * v.rhs;
            }
            inverses.push(inverse);
        }
        Some((left, rhs, inverses))
    }
}

struct Bundle<'a> {
    data: &'a Data<'a>,
    free: &'a [Shared],
    weights: Vec<Vec<f64>>,
    sigma_px: f64,
    normal: Normal,
}

impl Problem for Bundle<'_> {
    type Parameters = Parameters;

    fn cost(&mut self, p: &Parameters) -> f64 {
        let norms = self.data.norms(p);
        let corners = norms.iter().flatten().zip(self.weights.iter().flatten()).filter(|(_, w)| **w > 0.0);
        corners.map(|(r, w)| w * r * r).sum::<f64>() / self.sigma_px.powi(2) + self.data.prior(p)
    }

    fn linearize(&mut self, p: &Parameters, cost: f64) -> Option<f64> {
        self.normal = self.data.normal(p, self.free, &self.weights, self.sigma_px)?;
        Some(cost)
    }

    fn step(&mut self, p: &Parameters, damping: f64) -> Option<Parameters> {
        let (left, rhs, inverses) = self.normal.schur(damping)?;
        let shared = if rhs.is_empty() { rhs } else { left.cholesky()?.solve(&rhs) };
        let of = |(v, inverse): (&ViewNormal, &Matrix6<f64>)| {
            let rhs = if shared.is_empty() { v.rhs } else { v.rhs - v.mixed.tr_mul(&shared) };
            inverse * rhs
        };
        let poses: Vec<Vector6<f64>> = self.normal.views.iter().zip(&inverses).map(of).collect();
        Some(p.after(self.free, shared.as_slice(), &poses))
    }

    fn accept(&mut self, before: f64, after: f64) -> bool {
        before - after <= 1e-10 * before
    }
}
