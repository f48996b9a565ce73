//! From images to the curve.

use super::curve::CurveModel;
use super::error::ResponseError;
use super::fit::{FittedCurve, Squares, at, fixed, residuals, squares, weights};
use super::relation::LightRelation;
use super::report::{CandidateCurve, ResponseReport};
use super::rows::{NODES, Row, rows};
use crate::image::{Raw, Response};
use crate::statistics::{median, percentile};

/// Fewest relations in parts of the picture.
const MIN_ROWS: usize = 150;
/// Smallest part of the scale that the images must reach.
const MIN_HIGH: f64 = 0.5;
/// Largest standard error of the curve, of its height.
const MAX_ERROR: f64 = 0.01;
/// Largest typical difference between images and what they should show, of their light.
const MAX_RESIDUAL: f64 = 0.02;
/// Fewest folds of relations; with fewer, parts of the picture are left out instead.
const MIN_FOLDS: usize = 3;
/// Number of folds of parts of the picture.
const BLOCK_FOLDS: usize = 6;
/// A curve is no better than a simpler one for less than this part of what is left unexplained.
const NOTICEABLE: f64 = 0.06;
/// A curve is as good as a richer one that nowhere differs from it by more than this, of its height.
const SAME: f64 = 0.004;
/// Rows of one part of the picture share their images: standard errors from their number are too small by about this.
const SHARED: f64 = 3.0;
/// The curve whose parameters must be known for any curve to be.
const RICH: CurveModel = CurveModel::PowerTimes(2);

/// Gathers images of still scenes; see [`ResponseEstimator::finish`].
pub struct ResponseEstimator {
    levels: [f64; 2],
    rows: Vec<Row>,
}

impl ResponseEstimator {
    /// Returns one for a camera whose codes go from `black_level` to `saturation`.
    pub fn new(black_level: f64, saturation: f64) -> Self {
        Self { levels: [black_level, saturation], rows: Vec::new() }
    }

    /// Adds images of a still scene, and what is known of their light.
    ///
    /// # Errors
    ///
    /// The images differ in size.
    ///
    /// # Panics
    ///
    /// If a relation is about an image that is not there.
    pub fn add(&mut self, images: &[&Raw], relations: &[LightRelation]) -> Result<(), ResponseError> {
        self.rows.extend(rows(images, relations, self.levels)?);
        Ok(())
    }

    /// Finds the curve. A table is given the name `file`.
    ///
    /// # Errors
    ///
    /// The images are too dark or clipped, their light does not add up under any curve, or they leave it open.
    pub fn finish(&self, file: &str) -> Result<(Response, ResponseReport), ResponseError> {
        let rows = &self.rows;
        if rows.len() < MIN_ROWS {
            return Err(ResponseError::TooLittle { blocks: rows.len(), needed: MIN_ROWS });
        }
        let range = self.range();
        if range[1] < MIN_HIGH {
            return Err(ResponseError::TooDark { percent: 100.0 * range[1] });
        }
        let (folds, n_folds) = self.folds();
        let reference = range[1];
        // Weights depend on the curve; each time they are those of the last one.
        let mut light = CurveModel::Power.light(&[0.4]).expect("within its range");
        for round in 0..3 {
            let all = squares(rows, &weights(rows, &light, round > 0), &folds, n_folds);
            let fitted = Squares::sum(&all, None).fit(CurveModel::PowerTimes(1), reference);
            light = fitted.ok_or(ResponseError::Undetermined { percent: 100.0 })?.light;
        }
        let all = squares(rows, &weights(rows, &light, true), &folds, n_folds);
        let (model, candidates) =
            choose(&all, reference, range).ok_or(ResponseError::Undetermined { percent: 100.0 })?;
        let total = Squares::sum(&all, None);
        let curve = total.fit(model, reference).ok_or(ResponseError::Undetermined { percent: 100.0 })?;
        let adds_up = typical_residual(rows, &curve.light);
        if adds_up > MAX_RESIDUAL {
            return Err(ResponseError::DoesNotAddUp { percent: 100.0 * adds_up });
        }
        let error = standard_error(&all, &total, model, reference, range);
        if error.is_none_or(|e| e > MAX_ERROR) {
            return Err(ResponseError::Undetermined { percent: 100.0 * error.unwrap_or(1.0).min(1.0) });
        }
        let linear = CurveModel::Linear.light(&[]).expect("has no parameters");
        let apart = fixed(&curve.light, range).into_iter().zip(fixed(&linear, range)).enumerate();
        let apart = apart.filter(|(i, _)| within(*i, range)).map(|(_, (a, b))| (a - b).abs()).fold(0.0, f64::max);
        let middle = 0.5 * (range[0] + range[1]);
        let slope = (at(&curve.light, middle + 0.02) - at(&curve.light, middle - 0.02)) / 0.04;
        let report = ResponseReport {
            candidates,
            relations: rows.len(),
            range,
            adds_up_percent: 100.0 * adds_up,
            adds_up_linear_percent: 100.0 * typical_residual(rows, &linear),
            standard_error_percent: 100.0 * error.unwrap_or(0.0),
            from_linear_percent: 100.0 * apart,
            gamma: slope * middle / at(&curve.light, middle),
        };
        Ok((response(model, &curve, file), report))
    }

    /// Returns the codes from most of the darkest to most of the brightest.
    fn range(&self) -> [f64; 2] {
        let codes: Vec<f64> = self.rows.iter().flat_map(|r| r.terms.iter().map(|t| f64::from(t.1))).collect();
        let part = |p: f64| percentile(&mut codes.clone(), p).clamp(0.0, 1.0);
        [part(2.0), part(99.0)]
    }

    /// Returns what each row is left out together with.
    fn folds(&self) -> (Vec<usize>, usize) {
        let mut kinds: Vec<usize> = self.rows.iter().map(|r| r.relation_fold).collect();
        kinds.sort_unstable();
        kinds.dedup();
        if kinds.len() >= MIN_FOLDS {
            let fold = |r: &Row| kinds.binary_search(&r.relation_fold).expect("it is one of them");
            return (self.rows.iter().map(fold).collect(), kinds.len());
        }
        (self.rows.iter().map(|r| r.block % BLOCK_FOLDS).collect(), BLOCK_FOLDS)
    }
}

/// Returns the simplest family that predicts what was left out as well as any, or is hardly another curve within the
/// range than the one that does; and how each of them did.
fn choose(all: &[Squares], reference: f64, range: [f64; 2]) -> Option<(CurveModel, Vec<CandidateCurve>)> {
    let held_out = |model: CurveModel| -> Option<Vec<f64>> {
        let fold = |i: usize| {
            let curve = Squares::sum(all, Some(i)).fit(model, reference)?;
            Some(all[i].of(&curve.light, reference) / all[i].rows.max(1.0))
        };
        (0..all.len()).filter(|i| all[*i].rows > 0.0).map(fold).collect()
    };
    let tried: Vec<(CurveModel, Vec<f64>)> =
        CurveModel::ALL.into_iter().filter_map(|model| Some((model, held_out(model)?))).collect();
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (best_model, best) = tried.iter().min_by(|a, b| mean(&a.1).total_cmp(&mean(&b.1)))?;
    let total = Squares::sum(all, None);
    let curve = |model: CurveModel| Some(fixed(&total.fit(model, reference)?.light, range));
    let best_curve = curve(*best_model)?;
    let is_same = |model: CurveModel| {
        let apart = |c: Vec<f64>| {
            let nodes = c.iter().zip(&best_curve).enumerate().filter(|(i, _)| within(*i, range));
            nodes.map(|(_, (a, b))| (a - b).abs()).fold(0.0, f64::max)
        };
        curve(model).is_some_and(|c| apart(c) <= SAME)
    };
    let as_good = |errors: &[f64]| {
        let worse: Vec<f64> = errors.iter().zip(best).map(|(e, b)| e - b).collect();
        let m = mean(&worse);
        let variance = worse.iter().map(|w| (w - m).powi(2)).sum::<f64>() / (worse.len().max(2) - 1) as f64;
        m <= (variance / worse.len() as f64).sqrt() || m <= NOTICEABLE * mean(best)
    };
    let chosen = tried.iter().find(|(model, errors)| as_good(errors) || is_same(*model))?.0;
    let candidates = tried.iter().map(|(model, errors)| CandidateCurve {
        name: model.name(),
        parameters: model.parameters(),
        held_out: mean(errors).sqrt(),
        chosen: *model == chosen,
    });
    Some((chosen, candidates.collect()))
}

/// Returns the largest standard error of the curve within the range, of its height there: by leaving out one fold at a
/// time, and as propagated, whichever is larger. A simple curve is as uncertain as one that might have been chosen.
fn standard_error(all: &[Squares], total: &Squares, model: CurveModel, reference: f64, range: [f64; 2]) -> Option<f64> {
    let richer = if model.parameters() < RICH.parameters() { RICH } else { model };
    let propagated = total.standard_error(richer, &total.fit(richer, reference)?, reference, range, SHARED)?;
    let used: Vec<usize> = (0..all.len()).filter(|i| all[*i].rows > 0.0).collect();
    let without: Vec<Vec<f64>> = used
        .iter()
        .map(|i| Some(fixed(&Squares::sum(all, Some(*i)).fit(richer, reference)?.light, range)))
        .collect::<Option<_>>()?;
    let n = without.len() as f64;
    let error = |i: usize| {
        let mean = without.iter().map(|w| w[i]).sum::<f64>() / n;
        let variance = without.iter().map(|w| (w[i] - mean).powi(2)).sum::<f64>() * (n - 1.0) / n;
        variance.sqrt().max(propagated[i])
    };
    Some((0..NODES).filter(|i| within(*i, range)).map(error).fold(0.0, f64::max))
}

fn within(node: usize, [low, high]: [f64; 2]) -> bool {
    (low..=high).contains(&(node as f64 / (NODES - 1) as f64))
}

/// Returns the typical difference between images and what they should show, as a part of their light.
fn typical_residual(rows: &[Row], light: &[f64]) -> f64 {
    let mut parts: Vec<f64> = residuals(rows, light).into_iter().map(|(r, about)| r.abs() / about.max(1e-9)).collect();
    median(&mut parts).unwrap_or(0.0) / 0.6745
}

fn response(model: CurveModel, curve: &FittedCurve, file: &str) -> Response {
    match model {
        CurveModel::Linear => Response::Linear,
        CurveModel::Srgb => Response::Srgb,
        CurveModel::Power | CurveModel::PowerTimes(_) => Response::Table {
            file: file.into(),
            code: (0..NODES).map(|i| i as f64 / (NODES - 1) as f64).collect(),
            light: curve.light.clone(),
        },
    }
}
