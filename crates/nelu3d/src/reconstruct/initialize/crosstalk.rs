//! Estimates the crosstalk matrix of a color camera from a scene.
//!
//! The matrix has six free numbers. Any object with colors determines them, once its depth is roughly known: thousands of
//! pixels measure codewords of the field through mixtures that depend on nothing else. On gray objects the matrix has no
//! effect and need not be known.

use nalgebra::{SMatrix, SVector, Vector3};
use rayon::prelude::*;

use super::decoder::{Decoder, InitialDepth};
use crate::color_field::{CameraRays, SplineEvaluator};
use crate::sensor::{CrosstalkCorrection, CrosstalkMatrix, Measurements, relative_white};

/// Prior standard deviation of what a channel measures of another color.
const PRIOR: f64 = 0.1;
/// Range of an off-diagonal entry.
const LIMITS: [f64; 2] = [0.0, 0.4];
/// Error of a codeword that neighbors share (field, interreflection), added to the noise: it does not average out.
const SHARED_SIGMA: f32 = 0.02;
/// Number of pixels that share such errors and therefore count as one.
const PIXELS_PER_WITNESS: f64 = 50.0;
/// Largest number of pixels that are used.
const MAX_PIXELS: usize = 6_000;
/// χ² at which a residual's weight has fallen to a quarter (Geman-McClure).
const CUT: f64 = 18.0;

/// Finds surface and crosstalk matrix by turns: each is better with a better other. `measured` are the measurements before
/// any correction, `board` is white − black of the board per channel; `m` and `depth` are those of `crosstalk` at any time.
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
    /// Part of the misfit between surface and codewords, without any crosstalk, that it explains.
    explained: f32,
}

/// One image's three channels at one pixel.
struct Witness {
    codeword: Vector3<f32>,
    measured: Vector3<f32>,
    /// One over the standard deviation of each channel.
    weight: Vector3<f32>,
    /// White relative to the board's.
    white: Vector3<f32>,
}

impl Witness {
    fn residual(&self, correction: &CrosstalkCorrection) -> Vector3<f64> {
        let r = correction.object_from_board(self.white) * self.codeword - self.measured;
        r.component_mul(&self.weight).cast::<f64>()
    }
}

/// Pixels with a depth and all channels, evenly spread; `None` if there are too few.
fn witnesses(
    m: &Measurements,
    inv_z: &[f32],
    rays: &CameraRays,
    spline: &SplineEvaluator<'_>,
    board: &[f32; 3],
) -> Option<Vec<Witness>> {
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
            Witness { codeword: of(&c, 0), measured: of(&m.p, i * k), weight, white }
        })
    };
    Some(chosen.par_iter().flat_map_iter(of_pixel).collect())
}

/// The robust least-squares problem over the six free numbers of the matrix.
struct Problem {
    witnesses: Vec<Witness>,
}

impl Problem {
    /// Weighted residuals of every witness; `None` if the matrix is singular.
    fn residuals(&self, free: &[f64; 6]) -> Option<Vec<Vector3<f64>>> {
        let correction = CrosstalkCorrection::new(&CrosstalkMatrix::from_free(free))?;
        Some(self.witnesses.par_iter().with_min_len(256).map(|w| w.residual(&correction)).collect())
    }

    /// Robust χ² of residuals, in which wrong depths (outliers) count little.
    fn misfit(r: &[Vector3<f64>]) -> f64 {
        r.iter().map(|r| r.norm_squared() / (1.0 + r.norm_squared() / CUT)).sum::<f64>() / PIXELS_PER_WITNESS
    }

    fn cost(r: &[Vector3<f64>], free: &[f64; 6]) -> f64 {
        Self::misfit(r) + free.iter().map(|v| (v / PRIOR).powi(2)).sum::<f64>()
    }

    /// Matrix and right-hand side of the normal equations at `free`, whose residuals are `r`.
    fn normal_equations(&self, free: &[f64; 6], r: &[Vector3<f64>]) -> Option<(SMatrix<f64, 6, 6>, SVector<f64, 6>)> {
        const H: f64 = 1e-4;
        let mut slopes = Vec::with_capacity(6);
        for p in 0..6 {
            let mut moved = *free;
            moved[p] += H;
            slopes.push(self.residuals(&moved)?);
        }
        let (mut a, mut g) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
        for (i, r) in r.iter().enumerate() {
            let weight = (1.0 + r.norm_squared() / CUT).powi(-2) / PIXELS_PER_WITNESS;
            let j = SMatrix::<f64, 3, 6>::from_fn(|c, p| (slopes[p][i][c] - r[c]) / H);
            a += weight * j.transpose() * j;
            g += weight * j.transpose() * r;
        }
        for p in 0..6 {
            a[(p, p)] += PRIOR.powi(-2);
            g[p] += free[p] * PRIOR.powi(-2);
        }
        Some((a, g))
    }
}

/// Estimates the crosstalk matrix from measurements before any correction of a surface with inverse depth `inv_z` (NaN where
/// there is none), beginning at `start`, by Levenberg–Marquardt. `None` if too few pixels can tell.
fn estimate(
    m: &Measurements,
    inv_z: &[f32],
    rays: &CameraRays,
    spline: &SplineEvaluator<'_>,
    board: &[f32; 3],
    start: &CrosstalkMatrix,
) -> Option<Estimate> {
    let problem = Problem { witnesses: witnesses(m, inv_z, rays, spline, board)? };
    let mut free = start.free();
    let mut r = problem.residuals(&free)?;
    let mut least = Problem::cost(&r, &free);
    let mut damping = 1e-3;
    for _ in 0..25 {
        let (a, g) = problem.normal_equations(&free, &r)?;
        let mut gained = 0.0;
        while damping < 1e6 {
            let mut damped = a;
            for p in 0..6 {
                damped[(p, p)] *= 1.0 + damping;
            }
            let Some(step) = damped.cholesky().map(|c| c.solve(&g)) else { break };
            let next: [f64; 6] = std::array::from_fn(|p| (free[p] - step[p]).clamp(LIMITS[0], LIMITS[1]));
            if let Some(there) = problem.residuals(&next) {
                let c = Problem::cost(&there, &next);
                if c < least {
                    (gained, free, r, least) = (least - c, next, there, c);
                    damping = (damping * 0.1).max(1e-9);
                    break;
                }
            }
            damping *= 10.0;
        }
        if gained <= 1e-6 * least {
            break;
        }
    }
    let without = Problem::misfit(&problem.residuals(&[0.0; 6])?);
    let explained = if without > 0.0 { 1.0 - Problem::misfit(&r) / without } else { 0.0 };
    let crosstalk = CrosstalkMatrix::from_free(&free);
    tracing::info!(explained, ?crosstalk, "crosstalk");
    Some(Estimate { crosstalk, explained: explained as f32 })
}
