//! The curve of a family under which relations come out nearest to zero.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::curve::CurveModel;
use super::rows::{NODES, Row};
use crate::least_squares::{LmSettings, Problem, minimize};

/// Standard deviation of a code of one pixel, as a part of the scale: only the rows' ratios matter.
const CODE_SIGMA: f64 = 0.005;
/// Part of its light by which an image may be brighter or darker as a whole.
const FLICKER: f64 = 0.003;
/// Residuals beyond this many of the typical ones count less.
const ROBUST: f64 = 3.0;

/// Sum of squares of some rows as a quadratic form of the nodes' light.
#[derive(Clone)]
pub(super) struct Squares {
    pub(super) matrix: DMatrix<f64>,
    pub(super) rows: f64,
}

/// A curve of a family.
#[derive(Clone, Debug)]
pub(super) struct FittedCurve {
    pub(super) parameters: Vec<f64>,
    /// Light of each node, 1 at the last.
    pub(super) light: Vec<f64>,
}

/// Light of a code, between nodes in straight line.
pub(super) fn at(light: &[f64], code: f64) -> f64 {
    let at = code.clamp(0.0, 1.0) * (NODES - 1) as f64;
    let i = (at as usize).min(NODES - 2);
    light[i] + (at - i as f64) * (light[i + 1] - light[i])
}

/// Returns what each row comes out at, and the light that it is about.
pub(super) fn residuals(rows: &[Row], light: &[f64]) -> Vec<(f64, f64)> {
    let of = |row: &Row| {
        let sum: f64 = row.weights.iter().zip(light).map(|(w, l)| f64::from(*w) * l).sum();
        let about: f64 = row.terms.iter().map(|(w, c)| 0.5 * f64::from(w.abs()) * at(light, f64::from(*c))).sum();
        (sum, about)
    };
    rows.par_iter().map(of).collect()
}

/// Returns the weight of each row, 1/variance, if the curve is about this one.
pub(super) fn weights(rows: &[Row], light: &[f64], robust: bool) -> Vec<f64> {
    let found = residuals(rows, light);
    let step = 1.0 / (NODES - 1) as f64;
    let variance = |(row, (_, about)): (&Row, &(f64, f64))| {
        let noise = row.terms.iter().map(|(w, c)| {
            let c = f64::from(*c);
            let slope = (at(light, c + 2.0 * step) - at(light, (c - 2.0 * step).max(0.0))) / (4.0 * step);
            (f64::from(*w) * slope * CODE_SIGMA).powi(2)
        });
        noise.sum::<f64>() / row.pixels as f64 + (FLICKER * about).powi(2)
    };
    let variances: Vec<f64> = rows.iter().zip(&found).map(variance).collect();
    if !robust {
        return variances.iter().map(|v| 1.0 / v).collect();
    }
    let mut sizes: Vec<f64> = found.iter().zip(&variances).map(|((r, _), v)| r.abs() / v.sqrt()).collect();
    let typical = crate::statistics::median(&mut sizes.clone()).unwrap_or(1.0) / 0.6745;
    sizes.iter_mut().for_each(|s| *s = (ROBUST * typical / s.max(1e-12)).min(1.0));
    sizes.iter().zip(&variances).map(|(s, v)| s / v).collect()
}

/// Sums rows up, fold by fold.
pub(super) fn squares(rows: &[Row], weights: &[f64], folds: &[usize], n_folds: usize) -> Vec<Squares> {
    let sum = |fold: usize| {
        let mut matrix = DMatrix::<f64>::zeros(NODES, NODES);
        let mut n = 0.0;
        let mut filled: Vec<(usize, f64)> = Vec::new();
        for ((row, weight), _) in rows.iter().zip(weights).zip(folds).filter(|(_, f)| **f == fold) {
            filled.clear();
            filled.extend(row.weights.iter().enumerate().filter(|w| *w.1 != 0.0).map(|(i, w)| (i, f64::from(*w))));
            for (n, &(i, a)) in filled.iter().enumerate() {
                for &(j, b) in &filled[n..] {
                    // The lower triangle.
                    matrix[(j, i)] += weight * a * b;
                }
            }
            n += 1.0;
        }
        matrix.fill_upper_triangle_with_lower_triangle();
        Squares { matrix, rows: n }
    };
    (0..n_folds).into_par_iter().map(sum).collect()
}

impl Squares {
    /// Sums up all but one.
    pub(super) fn sum(all: &[Self], without: Option<usize>) -> Self {
        let mut total = Self { matrix: DMatrix::zeros(NODES, NODES), rows: 0.0 };
        for (_, s) in all.iter().enumerate().filter(|(i, _)| Some(*i) != without) {
            total.matrix += &s.matrix;
            total.rows += s.rows;
        }
        total
    }

    /// Returns the sum of squares of a curve, its light measured by that of the `reference` code: a curve that is steep
    /// above all data must not make all residuals small.
    pub(super) fn of(&self, light: &[f64], reference: f64) -> f64 {
        let unit = normalized(light, reference);
        // What is zero may come out below it.
        unit.dot(&(&self.matrix * &unit)).max(0.0)
    }

    /// Fits a family.
    pub(super) fn fit(&self, model: CurveModel, reference: f64) -> Option<FittedCurve> {
        let start = DVector::from_vec(model.start());
        let parameters = if start.is_empty() {
            start
        } else {
            let mut problem = CurveProblem { squares: self, model, reference, normal: None };
            minimize(&mut problem, start, &LmSettings { damping: 1e-3, max_iterations: 60, ..LmSettings::default() })?
        };
        let parameters: Vec<f64> = parameters.iter().copied().collect();
        Some(FittedCurve { light: model.light(&parameters)?, parameters })
    }

    /// Returns the standard error of the curve at every node, its ends of `range` fixed, from noise as it is expected or
    /// as the residuals have it, whichever is more; one row in `shared` counts. What the rows leave open is uncertain by
    /// what parameters are before anything is known: about 1.
    pub(super) fn standard_error(
        &self,
        model: CurveModel,
        curve: &FittedCurve,
        reference: f64,
        range: [f64; 2],
        shared: f64,
    ) -> Option<Vec<f64>> {
        let p = DVector::from_column_slice(&curve.parameters);
        let (d, _) = derivatives(model, &p, |light| normalized(light, reference))?;
        let spread = self.of(&curve.light, reference) / (self.rows - p.len() as f64).max(1.0);
        let information = d.transpose() * &self.matrix * &d / (shared * spread.max(1.0));
        let covariance = (information + DMatrix::identity(p.len(), p.len())).try_inverse()?;
        let (d, _) = derivatives(model, &p, |light| DVector::from_vec(fixed(light, range)))?;
        let variance = (0..NODES).map(|i| (d.row(i) * &covariance * d.row(i).transpose())[(0, 0)]);
        variance.map(|v| (v >= 0.0).then(|| v.sqrt())).collect()
    }
}

/// Returns a curve's light measured by that of a code.
fn normalized(light: &[f64], reference: f64) -> DVector<f64> {
    DVector::from_column_slice(light) / at(light, reference)
}

/// Returns a curve that is 0 and 1 at the ends of a range of codes: what normalized intensities are made of.
pub(super) fn fixed(light: &[f64], [low, high]: [f64; 2]) -> Vec<f64> {
    let (zero, one) = (at(light, low), at(light, high));
    light.iter().map(|v| (v - zero) / (one - zero)).collect()
}

/// Derivatives of a form of the curve by its parameters, and the form itself.
fn derivatives(
    model: CurveModel,
    p: &DVector<f64>,
    form: impl Fn(&[f64]) -> DVector<f64>,
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    const STEP: f64 = 1e-5;
    let here = form(&model.light(p.as_slice())?);
    let mut d = DMatrix::zeros(NODES, p.len());
    for i in 0..p.len() {
        let moved = |by: f64| {
            let mut q = p.clone();
            q[i] += by;
            model.light(q.as_slice()).map(|light| form(&light))
        };
        // At the end of its range a parameter has one side.
        let (ahead, behind) = (moved(STEP), moved(-STEP));
        let sides = f64::from(u8::from(ahead.is_some()) + u8::from(behind.is_some()));
        let change = ahead.as_ref().unwrap_or(&here) - behind.as_ref().unwrap_or(&here);
        d.set_column(i, &(change / (sides * STEP)));
    }
    Some((d, here))
}

/// Fitting a family as a problem of least squares.
struct CurveProblem<'a> {
    squares: &'a Squares,
    model: CurveModel,
    reference: f64,
    normal: Option<(DMatrix<f64>, DVector<f64>)>,
}

impl Problem for CurveProblem<'_> {
    type Parameters = DVector<f64>;

    fn cost(&mut self, p: &DVector<f64>) -> f64 {
        self.model.light(p.as_slice()).map_or(f64::INFINITY, |light| self.squares.of(&light, self.reference))
    }

    fn linearize(&mut self, p: &DVector<f64>, cost: f64) -> Option<f64> {
        let (d, here) = derivatives(self.model, p, |light| normalized(light, self.reference))?;
        let weighted = &self.squares.matrix * &d;
        self.normal = Some((d.transpose() * &weighted, -(weighted.transpose() * here)));
        Some(cost)
    }

    fn step(&mut self, p: &DVector<f64>, damping: f64) -> Option<DVector<f64>> {
        let (matrix, right) = self.normal.as_ref()?;
        let mut matrix = matrix.clone();
        (0..matrix.nrows()).for_each(|i| matrix[(i, i)] *= 1.0 + damping);
        Some(p + matrix.cholesky()?.solve(right))
    }

    fn accept(&mut self, before: f64, after: f64) -> bool {
        before - after <= 1e-9 * before
    }
}
