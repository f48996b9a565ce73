//! Estimates the crosstalk matrix of a color camera from a scene.
//!
//! The matrix has six free numbers. Any object with colors determines them, once its depth is roughly known: thousands
//! of pixels measure codewords of the field through combinations that depend on nothing else. On gray objects the
//! matrix has no effect and need not be known.

use nalgebra::{SMatrix, SVector, Vector3};
use nelu3d_scan::least_squares::{self, LmSettings, SingularSystem};
use rayon::prelude::*;

use super::decoder::{Decoder, InitialDepth};
use crate::color_field::{CameraRays, SplineEvaluator};
use crate::sensor::{CrosstalkCorrection, CrosstalkMatrix, Measurements, relative_white};

/// Prior standard deviation of an off-diagonal entry: how much a channel measures of another color.
const PRIOR: f64 = 0.1;
/// Range of an off-diagonal entry.
const LIMITS: [f64; 2] = [0.0, 0.4];
/// Error of a codeword that neighbors share (field, interreflection), added to the noise: it does not average out.
const SHARED_SIGMA: f32 = 0.02;
/// Number of pixels that share such errors and therefore count as one.
const PIXELS_PER_SAMPLE: f64 = 50.0;
/// Largest number of pixels that are used.
const MAX_PIXELS: usize = 6_000;
/// χ² at which a residual's weight has fallen to a quarter (Geman-McClure).
const CUT: f64 = 18.0;

/// Estimates crosstalk matrix and surface by turns, because each improves the other. `measured` are the measurements
/// before any correction, `board` is white − black of the board per channel; `m` and `depth` always belong to
/// `crosstalk`.
pub(super) fn alternate(
    decoder: &Decoder<'_>,
    measured: &Measurements,
    board: &[f32; 3],
    crosstalk: &mut CrosstalkMatrix,
    m: &mut Measurements,
    depth: &mut InitialDepth,
) {
    let s = &decoder.settings.crosstalk;
    for _ in 0..s.max_rounds {
        let estimate = estimate(measured, &depth.inv_z, decoder.rays, decoder.spline, board, crosstalk);
        // Without evidence for crosstalk none is corrected: errors with other causes are not to be bent into it.
        let Some(better) = estimate.filter(|e| e.explained > s.min_explained).map(|e| e.crosstalk) else { break };
        if better.difference(crosstalk) < s.settled {
            break;
        }
        *crosstalk = better;
        *m = measured.clone();
        m.correct_crosstalk(crosstalk, board);
        *depth = decoder.decode_filled(m);
    }
}

/// A crosstalk matrix and the evidence for it.
struct Estimate {
    crosstalk: CrosstalkMatrix,
    /// Fraction of χ² between surface and codewords, without any crosstalk, that the matrix explains.
    explained: f32,
}

/// The three channels of one image at one pixel.
struct Sample {
    /// Codeword of the field at the surface.
    codeword: Vector3<f32>,
    /// Measured codeword.
    measured: Vector3<f32>,
    /// One over the standard deviation of each channel.
    weight: Vector3<f32>,
    /// White − black relative to the board's.
    white: Vector3<f32>,
}

impl Sample {
    /// Returns the weighted residual of each channel.
    fn residual(&self, correction: &CrosstalkCorrection) -> Vector3<f64> {
        let r = correction.object_from_board(self.white) * self.codeword - self.measured;
        r.component_mul(&self.weight).cast::<f64>()
    }
}

/// Returns samples of pixels with a depth and all channels, evenly spread; `None` if there are too few.
fn samples(
    m: &Measurements,
    inv_z: &[f32],
    rays: &CameraRays,
    spline: &SplineEvaluator<'_>,
    board: &[f32; 3],
) -> Option<Vec<Sample>> {
    let k = m.k;
    let usable = |i: &usize| inv_z[*i].is_finite() && (0..k).all(|j| m.inv_var[i * k + j] > 0.0);
    let all: Vec<usize> = (0..m.n()).filter(usable).collect();
    let chosen: Vec<usize> = all.iter().copied().step_by(all.len() / MAX_PIXELS + 1).collect();
    if chosen.len() < 200 {
        return None;
    }
    let of_pixel = |i: &usize| {
        let mut c = vec![0.0; k];
        spline.eval(rays.in_frame(*i).at(f64::from(1.0 / (inv_z[*i] * rays.dir_z(*i)))).q, &mut c);
        let white = relative_white(m, *i, board);
        let i = *i;
        (0..k / 3).map(move |image| {
            let of = |v: &[f32], at: usize| Vector3::from_fn(|j, _| v[at + 3 * image + j]);
            let weight = of(&m.inv_var, i * k).map(|iv| 1.0 / (1.0 / iv + SHARED_SIGMA * SHARED_SIGMA).sqrt());
            Sample { codeword: of(&c, 0), measured: of(&m.p, i * k), weight, white }
        })
    };
    Some(chosen.par_iter().flat_map_iter(of_pixel).collect())
}

/// The robust least-squares problem over the six free numbers of the matrix.
struct Problem {
    samples: Vec<Sample>,
    /// Weighted residuals of the parameters whose cost was asked for last; `None` where their matrix is singular.
    residuals: Option<Vec<Vector3<f64>>>,
    normal: SMatrix<f64, 6, 6>,
    gradient: SVector<f64, 6>,
}

impl Problem {
    fn new(samples: Vec<Sample>) -> Self {
        Self { samples, residuals: None, normal: SMatrix::zeros(), gradient: SVector::zeros() }
    }

    /// Returns the weighted residuals of every sample; `None` if the matrix is singular.
    fn residuals(&self, free: &[f64; 6]) -> Option<Vec<Vector3<f64>>> {
        let correction = CrosstalkCorrection::new(&CrosstalkMatrix::from_free(free))?;
        Some(self.samples.par_iter().with_min_len(256).map(|s| s.residual(&correction)).collect())
    }

    /// Returns the robust χ² of residuals, in which wrong depths (outliers) count little.
    fn robust_chi2(r: &[Vector3<f64>]) -> f64 {
        r.iter().map(|r| r.norm_squared() / (1.0 + r.norm_squared() / CUT)).sum::<f64>() / PIXELS_PER_SAMPLE
    }
}

impl least_squares::Problem for Problem {
    type Parameters = [f64; 6];

    fn cost(&mut self, free: &[f64; 6]) -> f64 {
        self.residuals = Problem::residuals(self, free);
        let prior = free.iter().map(|v| (v / PRIOR).powi(2)).sum::<f64>();
        self.residuals.as_ref().map_or(f64::INFINITY, |r| Self::robust_chi2(r) + prior)
    }

    fn linearize(&mut self, free: &[f64; 6], cost: f64) -> Option<f64> {
        const H: f64 = 1e-4;
        let mut slopes = Vec::with_capacity(6);
        for p in 0..6 {
            let mut shifted = *free;
            shifted[p] += H;
            slopes.push(self.residuals(&shifted)?);
        }
        // The last cost is that of these parameters.
        let residuals = self.residuals.as_ref()?;
        let (mut a, mut g) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
        for (i, r) in residuals.iter().enumerate() {
            let weight = (1.0 + r.norm_squared() / CUT).powi(-2) / PIXELS_PER_SAMPLE;
            let j = SMatrix::<f64, 3, 6>::from_fn(|c, p| (slopes[p][i][c] - r[c]) / H);
            a += weight * j.transpose() * j;
            g += weight * j.transpose() * r;
        }
        for p in 0..6 {
            a[(p, p)] += PRIOR.powi(-2);
            g[p] += free[p] * PRIOR.powi(-2);
        }
        (self.normal, self.gradient) = (a, g);
        Some(cost)
    }

    fn step(&mut self, free: &[f64; 6], damping: f64) -> Option<[f64; 6]> {
        let mut damped = self.normal;
        for p in 0..6 {
            damped[(p, p)] *= 1.0 + damping;
        }
        let step = damped.cholesky()?.solve(&self.gradient);
        Some(std::array::from_fn(|p| (free[p] - step[p]).clamp(LIMITS[0], LIMITS[1])))
    }

    fn accept(&mut self, before: f64, after: f64) -> bool {
        before - after <= 1e-6 * after
    }
}

/// Estimates the crosstalk matrix from measurements before any correction of a surface with inverse depth `inv_z` (NaN
/// where there is none), beginning at `start`, by Levenberg–Marquardt. `None` if too few pixels can tell.
fn estimate(
    m: &Measurements,
    inv_z: &[f32],
    rays: &CameraRays,
    spline: &SplineEvaluator<'_>,
    board: &[f32; 3],
    start: &CrosstalkMatrix,
) -> Option<Estimate> {
    const SETTINGS: LmSettings = LmSettings {
        damping: 1e-3,
        min_damping: 1e-9,
        max_damping: 1e6,
        lower: 0.1,
        raise: 10.0,
        max_iterations: 25,
        max_trials: usize::MAX,
        max_total_trials: usize::MAX,
        accept_equal: false,
        singular: SingularSystem::RaisesDamping,
    };
    let mut problem = Problem::new(samples(m, inv_z, rays, spline, board)?);
    let free = least_squares::minimize(&mut problem, start.free(), &SETTINGS)?;
    let without = Problem::robust_chi2(&problem.residuals(&[0.0; 6])?);
    let with = Problem::robust_chi2(&problem.residuals(&free)?);
    let explained = if without > 0.0 { 1.0 - with / without } else { 0.0 };
    let crosstalk = CrosstalkMatrix::from_free(&free);
    tracing::info!(explained, ?crosstalk, "crosstalk");
    Some(Estimate { crosstalk, explained: explained as f32 })
}
