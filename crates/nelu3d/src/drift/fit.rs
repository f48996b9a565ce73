//! The rigid motion of the light that explains the codewords on boards best.

use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};
use nelu3d_scan::statistics::median;

use super::samples::{BoardSamples, OUTLIER};
use crate::color_field::grid::Grid;
use crate::color_field::{ColorField, LightMotion};

/// What a bump is expected to be, as standard deviations: a turn about the center of what was bumped (radians), and
/// little besides (mm). It decides only what the boards cannot tell, as between a turn and a shift of the light where
/// one board faces it.
const SIGMA_TURN: f64 = 0.02;
const SIGMA_MOVE_MM: f64 = 1.0;
/// Samples that count as one independent measurement: errors of a field and of a pose are alike over many pixels.
const CORRELATED: f64 = 100.0;
/// Largest shift in the image that is searched, as a part of its width; and the number of steps to it.
const REACH: f64 = 0.14;
const STEPS: i32 = 30;
/// Samples that the search looks at.
const SEARCHED: usize = 300;
/// Median χ² per measurement up to which a motion that was found from rest is believed without a search.
const EXPLAINED: f64 = 2.0;
/// Most steps of Gauss-Newton.
const ITERATIONS: usize = 30;

/// Boards and the field that they are compared with.
pub(super) struct Comparison<'a> {
    pub(super) views: &'a [&'a BoardSamples],
    pub(super) field: &'a ColorField,
    pub(super) grid: &'a Grid,
}

impl Comparison<'_> {
    /// Returns the median χ² per measurement if the light moved so.
    pub(super) fn chi2(&self, motion: &LightMotion) -> f64 {
        let undo = motion.isometry().inverse();
        let mut all: Vec<f64> = self.views.iter().flat_map(|v| v.misfits(self.field, self.grid, &undo, 1)).collect();
        median(&mut all).unwrap_or(f64::INFINITY)
    }

    /// Finds the motion that explains the samples best, as a turn about `about_mm` and a small shift, as far as the
    /// samples tell it.
    pub(super) fn fit(&self, about_mm: [f64; 3]) -> LightMotion {
        self.told(&self.best(about_mm))
    }

    /// Returns what of a motion the samples tell: its parts along the principal axes of what they tell (in units of
    /// what is expected) that are significant. Patterns that vary along one axis leave the other open, and small
    /// errors of the field look like motions along it.
    fn told(&self, motion: &LightMotion) -> LightMotion {
        /// Squared standard deviations.
        const SIGNIFICANT: f64 = 9.0;
        let sigma = |i: usize| if i < 3 { SIGMA_TURN } else { SIGMA_MOVE_MM };
        let (a, _) = self.normal_equations(motion);
        let eigen = Matrix6::from_fn(|i, j| a[(i, j)] * sigma(i) * sigma(j)).symmetric_eigen();
        let [r, t] = [motion.rotation, motion.translation_mm];
        let all = Vector6::from_fn(|i, _| if i < 3 { r[i] } else { t[i - 3] } / sigma(i));
        let mut told = Vector6::zeros();
        for (axis, information) in eigen.eigenvectors.column_iter().zip(eigen.eigenvalues.iter()) {
            let along = axis.dot(&all);
            if along * along * information > SIGNIFICANT {
                told += along * axis;
            }
        }
        let part = |first: usize| std::array::from_fn(|i| told[first + i] * sigma(first + i));
        LightMotion { rotation: part(0), translation_mm: part(3), ..*motion }
    }

    /// Finds the motion that explains the samples best.
    fn best(&self, about_mm: [f64; 3]) -> LightMotion {
        let from_rest = self.refine(LightMotion::none(about_mm));
        let chi2 = self.chi2(&from_rest);
        if chi2 < EXPLAINED {
            return from_rest;
        }
        let starts = self.search(about_mm);
        let found = starts.map(|start| self.refine(start)).map(|motion| (self.chi2(&motion), motion));
        let found = if found[0].0 < EXPLAINED.max(1.5 * found[1].0) { found[0] } else { found[1] };
        if found.0 < 0.7 * chi2 { found.1 } else { from_rest }
    }

    /// Returns the robust χ² of some samples, and what the prior adds.
    fn cost(&self, motion: &LightMotion, stride: usize) -> f64 {
        let undo = motion.isometry().inverse();
        let robust = |x: f64| if x.is_finite() { x / (1.0 + x / OUTLIER) } else { OUTLIER };
        let misfits = self.views.iter().flat_map(|v| v.misfits(self.field, self.grid, &undo, stride));
        misfits.map(robust).sum::<f64>() / CORRELATED + prior(motion)
    }

    /// Finds the smallest turn among those that explain the samples about as well as any, and the best one; they move
    /// the pattern by up to [`REACH`] across the image. Patterns that vary along one axis leave a motion along the other
    /// open.
    fn search(&self, about_mm: [f64; 3]) -> [LightMotion; 2] {
        /// Cost relative to the least up to which a turn explains as much.
        const AS_WELL: f64 = 1.5;
        let points = || self.views.iter().flat_map(|v| &v.points);
        let n = points().count();
        let middle = points().fold(Vector3::zeros(), |s, x| s + x.coords) / n as f64;
        let stride = (n / SEARCHED).max(1);
        let camera = &self.field.metadata.camera;
        let step = REACH * camera[0] / f64::from(STEPS) / camera[2] * middle.z;
        let arm = middle - Vector3::from(about_mm);
        let turned = |(a, b): (i32, i32)| {
            let shift = Vector3::new(f64::from(a) * step, f64::from(b) * step, 0.0);
            let rotation = (arm.cross(&shift) / arm.norm_squared()).into();
            LightMotion { rotation, ..LightMotion::none(about_mm) }
        };
        let all = (-STEPS..=STEPS).flat_map(|a| (-STEPS..=STEPS).map(move |b| turned((a, b))));
        let scored: Vec<(f64, LightMotion)> = all.map(|motion| (self.cost(&motion, stride), motion)).collect();
        let least = scored.iter().map(|s| s.0).fold(f64::INFINITY, f64::min);
        let turn = |motion: &LightMotion| Vector3::from(motion.rotation).norm();
        let close = scored.iter().filter(|s| s.0 <= AS_WELL * least);
        let smallest = close.min_by(|x, y| turn(&x.1).total_cmp(&turn(&y.1)));
        let best = scored.iter().min_by(|x, y| x.0.total_cmp(&y.0));
        [smallest, best].map(|s| s.map_or(LightMotion::none(about_mm), |s| s.1))
    }

    /// Gauss-Newton (Levenberg's damping) with Geman-McClure weights from `start`.
    fn refine(&self, start: LightMotion) -> LightMotion {
        let (mut motion, mut least, mut damping) = (start, self.cost(&start, 1), 1e-3);
        for _ in 0..ITERATIONS {
            let (a, b) = self.normal_equations(&motion);
            let mut damped = a;
            (0..6).for_each(|i| damped[(i, i)] *= 1.0 + damping);
            let Some(step) = damped.cholesky().map(|m| m.solve(&b)) else { break };
            let moved = |v: [f64; 3], i: usize| std::array::from_fn(|j| v[j] + step[i + j]);
            let next = LightMotion {
                rotation: moved(motion.rotation, 0),
                translation_mm: moved(motion.translation_mm, 3),
                ..motion
            };
            let found = self.cost(&next, 1);
            if found < least {
                let gain = least - found;
                (motion, least, damping) = (next, found, 0.3 * damping);
                if gain < 1e-6 * least {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        motion
    }

    /// Normal equations of a small further motion: rotation, then translation.
    fn normal_equations(&self, motion: &LightMotion) -> (Matrix6<f64>, Vector6<f64>) {
        let (mut a, mut b) = (Matrix6::zeros(), Vector6::zeros());
        let undo = motion.isometry().inverse();
        let pivot = Vector3::from(motion.about_mm) + Vector3::from(motion.translation_mm);
        for view in self.views {
            self.add_view(view, &undo, &pivot, &mut a, &mut b);
        }
        a /= CORRELATED;
        b /= CORRELATED;
        let now = motion.rotation.map(|v| (v, SIGMA_TURN)).into_iter();
        for (i, (v, sigma)) in now.chain(motion.translation_mm.map(|v| (v, SIGMA_MOVE_MM))).enumerate() {
            a[(i, i)] += 1.0 / (sigma * sigma);
            b[i] -= v / (sigma * sigma);
        }
        (a, b)
    }

    /// Adds the equations of one board.
    fn add_view(
        &self,
        view: &BoardSamples,
        undo: &Isometry3<f64>,
        pivot: &Vector3<f64>,
        a: &mut Matrix6<f64>,
        b: &mut Vector6<f64>,
    ) {
        /// Step of differences, mm.
        const H: f64 = 0.05;
        let k = view.k;
        let mut c: [Vec<f32>; 4] = std::array::from_fn(|_| vec![0.0; k]);
        for (i, x) in view.points.iter().enumerate() {
            let at = |d: Vector3<f64>| self.field.frame.to_unit(&(undo * (x + d)));
            let all = [at(Vector3::zeros()), at(H * Vector3::x()), at(H * Vector3::y()), at(H * Vector3::z())];
            if !all.iter().all(|q| q.is_some_and(|q| q.iter().all(|v| (0.0..=1.0).contains(v)))) {
                continue;
            }
            for (c, q) in c.iter_mut().zip(all) {
                self.grid.eval(q.unwrap_or_default(), c);
            }
            let weight = (1.0 + view.misfit(i, &c[0]) / OUTLIER).powi(-2) / k as f64;
            let arm = x.coords - pivot;
            for j in 0..k {
                let w = weight * f64::from(view.inv_var[i * k + j]);
                let own = f64::from(c[0][j]);
                let slope = Vector3::from_fn(|d, _| (f64::from(c[d + 1][j]) - own) / H);
                // The codeword at x is that of the point that moved there: it changes against the motion.
                let turn = -arm.cross(&slope);
                let row = Vector6::new(turn.x, turn.y, turn.z, -slope.x, -slope.y, -slope.z);
                *a += w * row * row.transpose();
                *b += w * (f64::from(view.p[i * k + j]) - own) * row;
            }
        }
    }
}

/// The prior's part of the cost.
fn prior(motion: &LightMotion) -> f64 {
    let of = |v: [f64; 3], sigma: f64| v.iter().map(|x| (x / sigma).powi(2)).sum::<f64>();
    of(motion.rotation, SIGMA_TURN) + of(motion.translation_mm, SIGMA_MOVE_MM)
}
