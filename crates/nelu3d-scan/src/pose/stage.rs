//! The stage model: one rotation, positions on one line.

use nalgebra::{Isometry3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};

use super::pnp::norms;
use super::robust::{huber, median, sigma_of_norms};
use crate::Camera;
use crate::board::Corner;
use crate::least_squares::{LmSettings, Problem, minimize};

/// `t_i = origin + s_i · dir`, the same rotation for all i.
#[derive(Clone, Debug)]
pub(super) struct Stage {
    pub(super) rotation: UnitQuaternion<f64>,
    pub(super) origin: Vector3<f64>,
    /// Unit direction; with equal steps, the step (mm).
    pub(super) dir: Vector3<f64>,
    /// Distance along `dir` of each position; with equal steps, its number.
    pub(super) s: Vec<f64>,
    /// Whether `s` is given rather than fitted.
    pub(super) equal_steps: bool,
}

/// Shared parameters: rotation 3, origin 3, direction 3 (of which two are used when it has unit length).
const G: usize = 9;

impl Stage {
    /// Fits the model to the corners of all positions. `poses` are the positions' free poses; `numbers` their places in
    /// the sweep, given when the steps between them are to be equal.
    pub(super) fn fit(
        views: &[&[Corner]],
        camera: &Camera,
        poses: &[Isometry3<f64>],
        numbers: Option<&[f64]>,
    ) -> Option<Self> {
        let mut stage = Self::seed(poses, numbers)?;
        for _ in 0..4 {
            let r: Vec<Vec<f64>> = views.iter().enumerate().map(|(i, v)| norms(v, camera, &stage.pose(i))).collect();
            let limit = 2.0 * sigma_of_norms(&r.concat()).max(1e-6);
            let weights: Vec<Vec<f64>> = r.iter().map(|r| r.iter().map(|&r| huber(r, limit)).collect()).collect();
            stage.refine(views, camera, &weights)?;
        }
        Some(stage)
    }

    pub(super) fn pose(&self, i: usize) -> Isometry3<f64> {
        self.pose_at(self.s[i])
    }

    pub(super) fn pose_at(&self, s: f64) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.origin + s * self.dir), self.rotation)
    }

    /// Starts with the mean rotation and the principal axis of the translations.
    fn seed(poses: &[Isometry3<f64>], numbers: Option<&[f64]>) -> Option<Self> {
        let n = poses.len() as f64;
        let base = poses[poses.len() / 2].rotation;
        // Component-wise medians: a position gone wrong must not spoil the start.
        let turns: Vec<Vector3<f64>> = poses.iter().map(|p| (p.rotation * base.inverse()).scaled_axis()).collect();
        let turn = Vector3::from_fn(|k, _| median(&turns.iter().map(|t| t[k]).collect::<Vec<_>>()));
        let rotation = UnitQuaternion::from_scaled_axis(turn) * base;
        let t: Vec<Vector3<f64>> = poses.iter().map(|p| p.translation.vector).collect();
        let mean = t.iter().sum::<Vector3<f64>>() / n;
        if let Some(numbers) = numbers {
            let m = numbers.iter().sum::<f64>() / n;
            let spread: f64 = numbers.iter().map(|i| (i - m).powi(2)).sum();
            let dir = numbers.iter().zip(&t).map(|(i, t)| (i - m) * (t - mean)).sum::<Vector3<f64>>() / spread;
            let origin = mean - m * dir;
            let ok = dir.iter().all(|v| v.is_finite());
            return ok.then(|| Self { rotation, origin, dir, s: numbers.to_vec(), equal_steps: true });
        }
        let scatter = t.iter().map(|t| (t - mean) * (t - mean).transpose()).sum::<nalgebra::Matrix3<f64>>();
        let eigen = scatter.symmetric_eigen();
        let mut dir = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        if dir.dot(&(t[t.len() - 1] - t[0])) < 0.0 {
            dir = -dir;
        }
        let origin = t[0];
        let s = t.iter().map(|t| (t - origin).dot(&dir)).collect();
        Some(Self { rotation, origin, dir, s, equal_steps: false })
    }

    /// Minimizes the weighted squared reprojection error of all corners.
    fn refine(&mut self, views: &[&[Corner]], camera: &Camera, weights: &[Vec<f64>]) -> Option<()> {
        let settings = LmSettings { damping: 1e-6, accept_equal: true, ..LmSettings::default() };
        let mut problem = StageReprojection { views, camera, weights, system: Arrow::default() };
        *self = minimize(&mut problem, self.clone(), &settings)?;
        Some(())
    }

    /// Returns two unit vectors across the direction.
    fn tangents(&self) -> [Vector3<f64>; 2] {
        let d = self.dir.normalize();
        let helper = if d.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
        let a = d.cross(&helper).normalize();
        [a, d.cross(&a)]
    }

    /// Returns the stage after a step of its shared parameters and of every position's own one.
    fn after_step(&self, shared: &SVector<f64, G>, own: &[f64]) -> Self {
        let mut next = self.clone();
        next.rotation = UnitQuaternion::from_scaled_axis(shared.fixed_rows::<3>(0).into_owned()) * self.rotation;
        next.origin += shared.fixed_rows::<3>(3);
        if self.equal_steps {
            next.dir += shared.fixed_rows::<3>(6);
        } else {
            let [a, b] = self.tangents();
            next.dir = (self.dir + shared[6] * a + shared[7] * b).normalize();
            next.s.iter_mut().zip(own).for_each(|(s, d)| *s += d);
        }
        next
    }

    fn normal_equations(&self, views: &[&[Corner]], camera: &Camera, weights: &[Vec<f64>]) -> Option<Arrow> {
        let mut arrow = Arrow::default();
        let tangents = self.tangents();
        for (i, view) in views.iter().enumerate() {
            let mut own = OwnParameter { cross: SVector::zeros(), diagonal: 0.0, rhs: 0.0 };
            let s = self.s[i];
            for (c, &w) in view.iter().zip(&weights[i]) {
                let arm = self.rotation * Vector3::new(c.board_mm[0], c.board_mm[1], 0.0);
                let (px, j) = camera.project_with_jacobian(&(arm + self.origin + s * self.dir).into())?;
                for k in 0..2 {
                    let jp = Vector3::new(j[(k, 0)], j[(k, 1)], j[(k, 2)]);
                    let turn = arm.cross(&jp);
                    let line = if self.equal_steps {
                        s * jp
                    } else {
                        Vector3::new(s * jp.dot(&tangents[0]), s * jp.dot(&tangents[1]), 0.0)
                    };
                    let row =
                        SVector::<f64, G>::from([turn.x, turn.y, turn.z, jp.x, jp.y, jp.z, line.x, line.y, line.z]);
                    let r = c.px[k] - px[k];
                    arrow.shared += w * row * row.transpose();
                    arrow.rhs += w * r * row;
                    // The first position's distance is 0 by definition, or the origin could slide along the line.
                    if !self.equal_steps && i > 0 {
                        let along = jp.dot(&self.dir);
                        own.cross += w * along * row;
                        own.diagonal += w * along * along;
                        own.rhs += w * r * along;
                    }
                }
            }
            arrow.own.push(own);
        }
        Some(arrow)
    }
}

/// The reprojection error of all positions of a stage.
struct StageReprojection<'a> {
    views: &'a [&'a [Corner]],
    camera: &'a Camera,
    weights: &'a [Vec<f64>],
    system: Arrow,
}

impl Problem for StageReprojection<'_> {
    type Parameters = Stage;

    fn cost(&mut self, stage: &Stage) -> f64 {
        let of = |i: usize| -> f64 {
            let r = norms(self.views[i], self.camera, &stage.pose(i));
            r.iter().zip(&self.weights[i]).map(|(r, w)| w * r * r).sum()
        };
        (0..self.views.len()).map(of).sum()
    }

    fn linearize(&mut self, stage: &Stage, cost: f64) -> Option<f64> {
        self.system = stage.normal_equations(self.views, self.camera, self.weights)?;
        Some(cost)
    }

    fn step(&mut self, stage: &Stage, damping: f64) -> Option<Stage> {
        let (shared, own) = self.system.solve(damping)?;
        Some(stage.after_step(&shared, &own))
    }

    fn accept(&mut self, before: f64, after: f64) -> bool {
        before - after <= 1e-13 * before
    }
}

/// Normal equations of shared parameters and one own parameter per position: an arrow, from which the own parameters
/// are eliminated one by one (Schur complement).
#[derive(Default)]
struct Arrow {
    shared: SMatrix<f64, G, G>,
    rhs: SVector<f64, G>,
    own: Vec<OwnParameter>,
}

/// The part of the normal equations that belongs to one position's own parameter.
struct OwnParameter {
    cross: SVector<f64, G>,
    diagonal: f64,
    rhs: f64,
}

impl Arrow {
    /// Solves for the shared parameters and every position's own one; `None` where the damped system is singular.
    fn solve(&self, damping: f64) -> Option<(SVector<f64, G>, Vec<f64>)> {
        let (mut a, mut g) = (self.shared, self.rhs);
        for i in 0..G {
            // A parameter that is not in use has an empty row; one on its diagonal leaves it at zero.
            a[(i, i)] = if a[(i, i)] > 0.0 { a[(i, i)] * (1.0 + damping) } else { 1.0 };
        }
        for o in self.own.iter().filter(|o| o.diagonal > 0.0) {
            let d = o.diagonal * (1.0 + damping);
            a -= o.cross * o.cross.transpose() / d;
            g -= o.cross * (o.rhs / d);
        }
        let shared = a.cholesky()?.solve(&g);
        let own = |o: &OwnParameter| {
            if o.diagonal > 0.0 { (o.rhs - o.cross.dot(&shared)) / (o.diagonal * (1.0 + damping)) } else { 0.0 }
        };
        Some((shared, self.own.iter().map(own).collect()))
    }
}
