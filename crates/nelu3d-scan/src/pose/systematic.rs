//! What the misfit of a sweep's corners has in common: wrong intrinsics, a missing lens distortion, a print that is
//! stretched, or a board that is bent each leave a pattern of their own in the reprojection errors.
//!
//! Every cause has a few parameters that all positions share. Linearized at the fitted poses, which stay free, they are
//! solved for by least squares (the poses are eliminated by the Schur complement), and the sum of squares that a cause
//! takes away tells how much of the misfit it explains. What explains a good part is solved for in full, since a focal
//! length that is wrong by a factor is far from linear, and looks like a stretched print where it is linearized.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Point3, SMatrix, Translation3, UnitQuaternion, Vector6};
use serde::Serialize;

use crate::Camera;
use crate::board::Corner;
use crate::camera::Distortion;

/// Number of shared parameters: focal length, aspect, center (2), distortion (4), stretch, shear, bend (3).
const N: usize = 13;

/// A cause of misfit that all positions of a sweep share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SharedCause {
    /// Focal lengths or the principal point are wrong.
    Intrinsics,
    /// Focal lengths, principal point, and lens distortion are wrong: those of another camera or resolution.
    Camera,
    /// The lens distortion is missing or wrong.
    Distortion,
    /// The print is stretched along one axis, or sheared.
    Print,
    /// The board is bent.
    Bend,
}

impl SharedCause {
    /// All causes.
    pub const ALL: [SharedCause; 5] =
        [SharedCause::Intrinsics, SharedCause::Camera, SharedCause::Distortion, SharedCause::Print, SharedCause::Bend];

    /// Returns the cause's parameters.
    fn parameters(self) -> std::ops::Range<usize> {
        match self {
            SharedCause::Intrinsics => 0..4,
            SharedCause::Camera => 0..8,
            SharedCause::Distortion => 4..8,
            SharedCause::Print => 8..10,
            SharedCause::Bend => 10..13,
        }
    }
}

/// How much of the misfit one cause explains.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Explanation {
    /// The cause.
    pub cause: SharedCause,
    /// Fraction of the corners' sum of squared residuals that the cause takes away.
    pub share: f64,
    /// F statistic of the cause: sum of squares that it takes away per parameter, over the variance that is left.
    pub f: f64,
    /// Bayesian information criterion (Schwarz 1978): the least of several causes is the likeliest.
    pub bic: f64,
    /// By how much depth on the boards changes when it is accounted for: root mean square over each board, median over
    /// the positions, mm.
    pub depth_mm: f64,
    /// Largest amount of the cause's parameters: relative change of the focal length, coefficient of distortion,
    /// relative stretch, sagitta in mm.
    pub amount: f64,
}

/// The misfit of a sweep's corners, and what could explain it.
#[derive(Clone, Debug, Serialize)]
pub struct SharedMisfit {
    /// Root mean square reprojection error with free poses, px.
    pub rms_px: f64,
    /// The same with every cause accounted for, px.
    pub rms_explained_px: f64,
    /// Standard deviation of the focal length that the corners leave, relative, if they are believed alone; boards that
    /// face the camera do not tell it.
    pub focal_sigma: f64,
    /// Every cause on its own.
    pub causes: Vec<Explanation>,
}

impl SharedMisfit {
    /// Returns the likeliest cause among those that `counts` admits.
    pub fn likeliest(&self, counts: impl Fn(&Explanation) -> bool) -> Option<&Explanation> {
        self.causes.iter().filter(|e| counts(e)).min_by(|a, b| a.bic.total_cmp(&b.bic))
    }
}

/// Corners of a board in one image, and the board's pose, camera from board, mm.
type View<'a> = (&'a [Corner], Isometry3<f64>);

/// The normal equations of one view, poses first.
struct ViewEquations {
    /// Inverse of the pose's normal matrix.
    pose: Matrix6<f64>,
    /// Normal matrix between pose and shared parameters.
    cross: SMatrix<f64, 6, N>,
    rhs: Vector6<f64>,
    /// Depth (camera z) of each corner by the pose's and by the shared parameters.
    depth: Vec<(Vector6<f64>, SMatrix<f64, N, 1>)>,
}

/// The normal equations of a sweep at shared parameters, poses eliminated.
struct Equations {
    views: Vec<ViewEquations>,
    a: SMatrix<f64, N, N>,
    b: SMatrix<f64, N, 1>,
    /// Sum of squares that the poses leave, px².
    s: f64,
}

/// Fraction of the sum of squares that a cause takes away in the linearized problem to be solved for in full.
const WORTH: f64 = 0.2;
/// Coordinates of corners that count as one independent measurement: errors of a corner are alike in all images.
const CORRELATED: f64 = 4.0;
/// Most views that are looked at for that.
const MAX_VIEWS: usize = 12;

/// Asks what explains the misfit of corners with these poses, view by view. `None` where there are fewer than 40
/// corners or two views, which tell too little.
pub fn explain_misfit(views: &[(&[Corner], Isometry3<f64>)], camera: &Camera) -> Option<SharedMisfit> {
    const MIN_CORNERS: usize = 40;
    let n_corners: usize = views.iter().map(|v| v.0.len()).sum();
    if views.len() < 2 || n_corners < MIN_CORNERS {
        return None;
    }
    let board = Extent::of(views.iter().flat_map(|v| v.0));
    let at = Equations::new(views, camera, &board, &[0.0; N])?;
    let freedom = ((2 * n_corners) as f64 - (6 * views.len() + N) as f64).max(1.0);
    let prior = priors(camera, at.s / freedom);
    let (gain, _) = at.solve(0..N, &prior, &[0.0; N], 0.0)?;
    let left = (at.s - gain).max(1e-12 * at.s.max(1e-12));
    let mut causes = Vec::new();
    for cause in SharedCause::ALL {
        let which = cause.parameters();
        let Some((gain, x)) = at.solve(which.clone(), &prior, &[0.0; N], 0.0) else { continue };
        let mut found = Found { share: gain / at.s.max(1e-300), depth_mm: at.depth_change(&x), x: x.into() };
        if found.share > WORTH
            && let Some(full) = solve_in_full(views, camera, &board, which.clone())
            && full.share > found.share
        {
            found = full;
        }
        let own = if which.start == 0 { 0..2 } else { which.clone() };
        let amount = own.map(|i| found.x[i].abs()).fold(0.0, f64::max);
        let (n, left) = (which.len() as f64, (1.0 - found.share).max(1e-12));
        let f = found.share / n / (left / freedom);
        let measured = 2.0 * n_corners as f64 / CORRELATED;
        let bic = measured * left.ln() + n * measured.max(std::f64::consts::E).ln();
        causes.push(Explanation { cause, share: found.share, f, bic, depth_mm: found.depth_mm, amount });
    }
    let rms = |s: f64| (s / n_corners as f64).sqrt();
    let focal_sigma = at.sigma(SharedCause::Intrinsics.parameters(), &prior, left / freedom)?;
    Some(SharedMisfit { rms_px: rms(at.s), rms_explained_px: rms(left), focal_sigma, causes })
}

/// What a cause explains, and with which parameters.
struct Found {
    share: f64,
    depth_mm: f64,
    x: [f64; N],
}

/// Solves for the parameters of one cause and all poses by Levenberg-Marquardt steps, on some of the views.
fn solve_in_full(views: &[View<'_>], camera: &Camera, board: &Extent, which: std::ops::Range<usize>) -> Option<Found> {
    const STEPS: usize = 20;
    let mut poses: Vec<View<'_>> = views.iter().step_by(views.len().div_ceil(MAX_VIEWS)).copied().collect();
    let first = poses.clone();
    let (mut x, mut damping) = ([0.0; N], 1e-4);
    let mut at = Equations::new(&poses, camera, board, &x)?;
    let start = at.s;
    let n_corners: usize = poses.iter().map(|v| v.0.len()).sum();
    let prior = priors(camera, start / (2 * n_corners) as f64);
    for _ in 0..STEPS {
        let (_, step) = at.solve(which.clone(), &prior, &x, damping)?;
        let moved: Vec<View<'_>> =
            poses.iter().zip(&at.views).map(|((c, pose), e)| (*c, turned(pose, board, &e.pose_step(&step)))).collect();
        let next: [f64; N] = std::array::from_fn(|i| x[i] + step[i]);
        match Equations::new(&moved, camera, board, &next).filter(|found| found.s < at.s) {
            Some(found) => {
                let gain = at.s - found.s;
                (poses, x, at, damping) = (moved, next, found, 0.2 * damping);
                if gain < 1e-4 * at.s {
                    break;
                }
            }
            None => {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
    }
    let mut depths: Vec<f64> = Vec::with_capacity(poses.len());
    for ((corners, then), (_, now)) in first.iter().zip(&poses) {
        let z = |pose: &Isometry3<f64>, c: &Corner, x: &[f64; N]| (pose * on_board(c, board, x)).z;
        let squares = corners.iter().map(|c| (z(now, c, &x) - z(then, c, &[0.0; N])).powi(2));
        depths.push((squares.sum::<f64>() / corners.len().max(1) as f64).sqrt());
    }
    depths.sort_by(f64::total_cmp);
    Some(Found { share: 1.0 - at.s / start.max(1e-300), depth_mm: depths[depths.len() / 2], x })
}

impl Equations {
    fn new(views: &[View<'_>], camera: &Camera, board: &Extent, x: &[f64; N]) -> Option<Self> {
        let (mut a, mut b, mut s) = (SMatrix::<f64, N, N>::zeros(), SMatrix::<f64, N, 1>::zeros(), 0.0);
        let mut equations = Vec::with_capacity(views.len());
        for (corners, pose) in views {
            let (mut pp, mut cross) = (Matrix6::<f64>::zeros(), SMatrix::<f64, 6, N>::zeros());
            let (mut tt, mut t, mut p, mut rr) = (a * 0.0, b * 0.0, Vector6::zeros(), 0.0);
            let mut depth = Vec::with_capacity(corners.len());
            for corner in *corners {
                let (r, jp, jt) = linearize(corner, pose, camera, board, x)?;
                for k in 0..2 {
                    let (jp, jt) = (jp.column(k), jt.column(k));
                    pp += jp * jp.transpose();
                    cross += jp * jt.transpose();
                    tt += jt * jt.transpose();
                    t += jt * r[k];
                    p += jp * r[k];
                    rr += r[k] * r[k];
                }
                depth.push((jp.column(2).into_owned(), jt.column(2).into_owned()));
            }
            let pose = pp.try_inverse()?;
            a += tt - cross.transpose() * pose * cross;
            b += t - cross.transpose() * pose * p;
            s += rr - p.dot(&(pose * p));
            equations.push(ViewEquations { pose, cross, rhs: p, depth });
        }
        s.is_finite().then_some(Self { views: equations, a, b, s })
    }

    /// Normal matrix of some of the parameters, with their prior.
    fn matrix(&self, which: &std::ops::Range<usize>, prior: &[f64; N]) -> DMatrix<f64> {
        DMatrix::from_fn(which.len(), which.len(), |i, j| {
            self.a[(which.start + i, which.start + j)] + if i == j { prior[which.start + i] } else { 0.0 }
        })
    }

    /// Solves for a further step of some of the parameters from `x`; returns the gain and the step.
    fn solve(
        &self,
        which: std::ops::Range<usize>,
        prior: &[f64; N],
        x: &[f64; N],
        damping: f64,
    ) -> Option<(f64, SMatrix<f64, N, 1>)> {
        let mut m = self.matrix(&which, prior);
        (0..which.len()).for_each(|i| m[(i, i)] *= 1.0 + damping);
        let v =
            DVector::from_fn(which.len(), |i, _| self.b[which.start + i] - prior[which.start + i] * x[which.start + i]);
        let step = m.cholesky()?.solve(&v);
        let mut all = SMatrix::<f64, N, 1>::zeros();
        (0..which.len()).for_each(|i| all[which.start + i] = step[i]);
        Some((v.dot(&step), all))
    }

    /// Standard deviation of the first of some parameters, the others free, at a variance of the corners (px²).
    fn sigma(&self, which: std::ops::Range<usize>, prior: &[f64; N], variance: f64) -> Option<f64> {
        let inverse = self.matrix(&which, prior).try_inverse()?;
        Some((variance * inverse[(0, 0)]).max(0.0).sqrt())
    }

    /// Change of depth that shared parameters `x` cause: root mean square over each board, median over them, mm.
    fn depth_change(&self, x: &SMatrix<f64, N, 1>) -> f64 {
        let mut depths: Vec<f64> = self.views.iter().map(|e| e.depth_change(x)).collect();
        depths.sort_by(f64::total_cmp);
        depths[depths.len() / 2]
    }
}

impl ViewEquations {
    /// The pose's step that goes with a step `x` of the shared parameters.
    fn pose_step(&self, x: &SMatrix<f64, N, 1>) -> Vector6<f64> {
        self.pose * (self.rhs - self.cross * x)
    }

    /// Root mean square change of depth over the board's corners that shared parameters `x` cause, mm.
    fn depth_change(&self, x: &SMatrix<f64, N, 1>) -> f64 {
        let pose = self.pose_step(x);
        let unexplained = self.pose * self.rhs;
        let squares = self.depth.iter().map(|(p, t)| (p.dot(&(pose - unexplained)) + t.dot(x)).powi(2));
        (squares.sum::<f64>() / self.depth.len().max(1) as f64).sqrt()
    }
}

/// What is known of the shared parameters beforehand, as inverse variances times the corners' variance: it matters only
/// where the corners tell nothing.
fn priors(camera: &Camera, variance: f64) -> [f64; N] {
    let center = 0.1 * camera.width as f64;
    let sigmas = [0.3, 0.05, center, center, 0.5, 0.5, 0.02, 0.02, 0.05, 0.05, 10.0, 10.0, 10.0];
    sigmas.map(|s: f64| variance / (s * s))
}

/// Middle and half size of what corners cover of the board, mm.
struct Extent {
    middle: [f64; 2],
    half: f64,
}

impl Extent {
    fn of<'a>(corners: impl Iterator<Item = &'a Corner>) -> Self {
        let (mut lo, mut hi) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for c in corners {
            for i in 0..2 {
                (lo[i], hi[i]) = (lo[i].min(c.board_mm[i]), hi[i].max(c.board_mm[i]));
            }
        }
        let half = 0.5 * (hi[0] - lo[0]).max(hi[1] - lo[1]).max(1e-9);
        Self { middle: [0.5 * (lo[0] + hi[0]), 0.5 * (lo[1] + hi[1])], half }
    }
}

/// Returns a pose after a step: a turn about the board's middle, then a shift (mm).
fn turned(pose: &Isometry3<f64>, board: &Extent, step: &Vector6<f64>) -> Isometry3<f64> {
    let middle = (pose * Point3::new(board.middle[0], board.middle[1], 0.0)).coords;
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
    let about = Translation3::from(middle) * turn * Translation3::from(-middle);
    Translation3::from(step.fixed_rows::<3>(3).into_owned()) * about * pose
}

/// Residual of a corner at shared parameters `x`, px; derivatives of pixel x, pixel y, and camera z by the pose (rotation about the board's
/// middle, translation) and by the shared parameters, in columns.
fn linearize(
    corner: &Corner,
    pose: &Isometry3<f64>,
    camera: &Camera,
    board: &Extent,
    x: &[f64; N],
) -> Option<([f64; 2], SMatrix<f64, 6, 3>, SMatrix<f64, N, 3>)> {
    let at = |pose: &Isometry3<f64>, x: &[f64; N]| project(corner, pose, camera, board, x);
    let px = at(pose, x)?;
    let mut by_pose = SMatrix::<f64, 6, 3>::zeros();
    for i in 0..6 {
        let h = if i < 3 { 1e-5 } else { 1e-3 };
        let moved = |h: f64| {
            let mut step = Vector6::zeros();
            step[i] = h;
            turned(pose, board, &step)
        };
        let (p, m) = (at(&moved(h), x)?, at(&moved(-h), x)?);
        (0..3).for_each(|k| by_pose[(i, k)] = (p[k] - m[k]) / (2.0 * h));
    }
    let mut by_shared = SMatrix::<f64, N, 3>::zeros();
    for i in 0..N {
        let h = if (2..4).contains(&i) || i >= 10 { 1e-2 } else { 1e-5 };
        let moved = |h: f64| {
            let mut x = *x;
            x[i] += h;
            x
        };
        let (p, m) = (at(pose, &moved(h))?, at(pose, &moved(-h))?);
        (0..3).for_each(|k| by_shared[(i, k)] = (p[k] - m[k]) / (2.0 * h));
    }
    Some(([corner.px[0] - px[0], corner.px[1] - px[1]], by_pose, by_shared))
}

/// Where a corner is in the board's frame with shared parameters `x`, mm.
fn on_board(corner: &Corner, board: &Extent, x: &[f64; N]) -> Point3<f64> {
    let [u, v] = [0, 1].map(|i| corner.board_mm[i] - board.middle[i]);
    let (a, b) = (u / board.half, v / board.half);
    let bent = x[10] * a * a + x[11] * a * b + x[12] * b * b;
    Point3::new(corner.board_mm[0] + x[8] * u + x[9] * v, corner.board_mm[1], bent)
}

/// Pixel and camera z of a corner with shared parameters `x`.
fn project(corner: &Corner, pose: &Isometry3<f64>, camera: &Camera, board: &Extent, x: &[f64; N]) -> Option<[f64; 3]> {
    let mut coeffs = camera.distortion.coeffs().to_vec();
    coeffs.resize(coeffs.len().max(5), 0.0);
    (0..4).for_each(|i| coeffs[i] += x[4 + i]);
    let changed = Camera {
        fx: camera.fx * (x[0] + x[1]).exp(),
        fy: camera.fy * x[0].exp(),
        cx: camera.cx + x[2],
        cy: camera.cy + x[3],
        distortion: Distortion::new(&coeffs)?,
        ..camera.clone()
    };
    let p = pose * on_board(corner, board, x);
    let [px, py] = changed.project(&p)?;
    Some([px, py, p.z])
}
