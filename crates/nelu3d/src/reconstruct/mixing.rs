//! Cross-talk: a camera's red, green and blue each see some of the light's other colors.
//!
//! A light source sends three colors, each with its own pattern c′_m(x). The board returns all alike, so on it channel i
//! measures `c_i = Σ_m A_im c′_m`, with rows of A that sum to one: c is the color field, as it was learned. A colored object returns
//! the share ρ_m of each, and channel i measures `p_i = Σ_m A_im ρ_m c′_m / Σ_m A_im ρ_m`: another mixture, which no
//! point of the field explains (a failure in the paper's Fig. 8). But its flash, with c′ = 1 everywhere, is `W_i ∝ Σ_m A_im ρ_m` (relative to the
//! board's flash), so ρ = A⁻¹ W is known at every pixel once A is; and p is taken back to what the board would have shown there:
//! `c = A diag(1/ρ) A⁻¹ diag(Aρ) p`.
//!
//! A has six free numbers. Any object with colors tells them, once its depth is roughly known: thousands of pixels see codewords of the
//! field through mixtures that depend on nothing else. On gray objects A has no effect, and need not be known.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::lookup::{Lookup, Rays};
use super::measure::Measurements;
use crate::result::Left;

/// The mixing matrix A of a camera and light source with three colors: rows are the camera's channels and sum to one, columns the
/// light's colors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mixing(pub [[f32; 3]; 3]);

/// Shares of light below this part of the largest are taken for it: a surface returns some of every color.
const LEAST_SHARE: f32 = 0.02;
/// Prior standard deviation of what a channel sees of another color.
const PRIOR: f64 = 0.1;
/// Limits of that.
const LIMITS: [f64; 2] = [0.0, 0.4];
/// Error of a codeword that neighbors share (field, interreflection), added to the noise: it does not average out.
const SHARED_SIGMA: f32 = 0.02;
/// Pixels share such errors: so many are worth one.
const PIXELS_A_WITNESS: f64 = 50.0;
/// Pixels that are asked.
const MOST_ASKED: usize = 6_000;

impl Mixing {
    /// No cross-talk.
    pub const NONE: Self = Self([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);

    /// The largest difference of an entry.
    pub fn difference(&self, other: &Self) -> f32 {
        self.0.iter().flatten().zip(other.0.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    fn from_free(free: &[f64; 6]) -> Self {
        let [a, b, c, d, e, f] = free.map(|v| v as f32);
        Self([[1.0 - a - b, a, b], [c, 1.0 - c - d, d], [e, f, 1.0 - e - f]])
    }

    fn free(&self) -> [f64; 6] {
        let m = &self.0;
        [m[0][1], m[0][2], m[1][0], m[1][2], m[2][0], m[2][1]].map(f64::from)
    }

    fn matrix(&self) -> Matrix3<f32> {
        Matrix3::from_fn(|i, j| self.0[i][j])
    }
}

/// A mixing with its inverse, at hand for many pixels.
struct Ready {
    a: Matrix3<f32>,
    inverse: Matrix3<f32>,
}

impl Ready {
    fn new(mixing: &Mixing) -> Option<Self> {
        let a = mixing.matrix();
        Some(Self { a, inverse: a.try_inverse()? })
    }

    /// The share ρ of each of the light's colors that a pixel returns, largest 1, from its flash relative to the board's.
    fn shares(&self, flash: Vector3<f32>) -> Vector3<f32> {
        let rho = self.inverse * flash;
        let most = rho.max().max(1e-6);
        rho.map(|v| (v / most).max(LEAST_SHARE))
    }

    /// What takes a codeword of the field to that of an object.
    fn off_board(&self, flash: Vector3<f32>) -> Matrix3<f32> {
        let rho = self.shares(flash);
        let total = self.a * rho;
        let mixed = self.a * Matrix3::from_diagonal(&rho) * self.inverse;
        Matrix3::from_fn(|i, j| mixed[(i, j)] / total[i])
    }

    /// The way back.
    fn to_board(&self, flash: Vector3<f32>) -> Matrix3<f32> {
        let rho = self.shares(flash);
        self.a * Matrix3::from_diagonal(&rho.map(|v| 1.0 / v)) * self.inverse * Matrix3::from_diagonal(&(self.a * rho))
    }
}

/// White − black of a pixel relative to the board's, per channel.
fn flash(m: &Measurements, i: usize, board: &[f32; 3]) -> Vector3<f32> {
    Vector3::from_fn(|c, _| m.light[i * 3 + c] / board[c])
}

impl Measurements {
    /// Takes every codeword back to what the board would have shown. `board` is the color of its flash.
    pub(super) fn unmix(&mut self, mixing: &Mixing, board: &[f32; 3]) {
        let Some(ready) = Ready::new(mixing) else { return };
        let (k, n) = (self.k, self.n());
        for i in 0..n {
            if self.left[i] != Left::Kept {
                continue;
            }
            let back = ready.to_board(flash(self, i, board));
            for image in 0..k / 3 {
                let at = i * k + 3 * image;
                let p = Vector3::from_fn(|c, _| self.p[at + c]);
                let inv_var = Vector3::from_fn(|c, _| self.inv_var[at + c]);
                for c in 0..3 {
                    let row = back.row(c);
                    let mut variance = 0.0;
                    for j in 0..3 {
                        // A channel that cannot be used says nothing, and spoils those that need it.
                        if inv_var[j] > 0.0 {
                            variance += row[j] * row[j] / inv_var[j];
                        } else if row[j].abs() > 0.02 {
                            variance = f32::INFINITY;
                        }
                    }
                    self.p[at + c] = (row * p)[0];
                    self.inv_var[at + c] = if variance > 0.0 { 1.0 / variance } else { 0.0 };
                }
            }
        }
        self.surround = self.surroundings();
    }
}

/// A mixing, and what speaks for it.
pub(super) struct Estimate {
    /// The mixing.
    pub(super) mixing: Mixing,
    /// Part of the misfit between surface and codewords, without any mixing, that it explains.
    pub(super) explained: f32,
}

/// Estimates the mixing from measurements `m` (as taken, not unmixed) of a surface with inverse depth `inv_z` (NaN where there is none).
/// `None` if too few pixels can tell. `start` is where to begin.
pub(super) fn estimate(
    m: &Measurements,
    inv_z: &[f32],
    rays: &Rays,
    lookup: &Lookup<'_>,
    board: &[f32; 3],
    start: &Mixing,
) -> Option<Estimate> {
    struct Witness {
        codeword: Vector3<f32>,
        measured: Vector3<f32>,
        weight: Vector3<f32>,
        flash: Vector3<f32>,
    }
    let k = m.k;
    let able = |i: &usize| inv_z[*i].is_finite() && (0..k).all(|j| m.inv_var[i * k + j] > 0.0);
    let all: Vec<usize> = (0..m.n()).filter(able).collect();
    let asked: Vec<usize> = all.iter().copied().step_by(all.len() / MOST_ASKED + 1).collect();
    if asked.len() < 200 {
        return None;
    }
    let witnesses: Vec<Witness> = asked
        .par_iter()
        .flat_map_iter(|i| {
            let mut c = vec![0.0; k];
            lookup.eval(rays.in_frame(*i).at(f64::from(1.0 / (inv_z[*i] * rays.dir_z(*i)))).q, &mut c);
            let flash = flash(m, *i, board);
            (0..k / 3).map(move |image| {
                let of = |v: &[f32], at: usize| Vector3::from_fn(|j, _| v[at + 3 * image + j]);
                Witness {
                    codeword: of(&c, 0),
                    measured: of(&m.p, i * k),
                    weight: of(&m.inv_var, i * k).map(|iv| 1.0 / (1.0 / iv + SHARED_SIGMA * SHARED_SIGMA).sqrt()),
                    flash,
                }
            })
        })
        .collect();
    // Residuals, one column of three per witness, and the cost with wrong depths (outliers) losing their say.
    const CUT: f64 = 18.0;
    let residuals = |free: &[f64; 6]| -> Option<Vec<Vector3<f64>>> {
        let ready = Ready::new(&Mixing::from_free(free))?;
        let one = |w: &Witness| {
            let r = ready.off_board(w.flash) * w.codeword - w.measured;
            r.component_mul(&w.weight).cast::<f64>()
        };
        Some(witnesses.par_iter().with_min_len(256).map(one).collect())
    };
    let misfit = |r: &[Vector3<f64>]| -> f64 {
        r.iter().map(|r| r.norm_squared() / (1.0 + r.norm_squared() / CUT)).sum::<f64>() / PIXELS_A_WITNESS
    };
    let cost = |r: &[Vector3<f64>], free: &[f64; 6]| -> f64 {
        misfit(r) + free.iter().map(|v| (v / PRIOR).powi(2)).sum::<f64>()
    };
    let mut free = start.free();
    let mut r = residuals(&free)?;
    let mut least = cost(&r, &free);
    let mut damping = 1e-3;
    for _ in 0..25 {
        const H: f64 = 1e-4;
        let mut slopes = Vec::with_capacity(6);
        for p in 0..6 {
            let mut moved = free;
            moved[p] += H;
            slopes.push(residuals(&moved)?);
        }
        let (mut a, mut g) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
        for (i, r) in r.iter().enumerate() {
            let weight = (1.0 + r.norm_squared() / CUT).powi(-2) / PIXELS_A_WITNESS;
            let j = SMatrix::<f64, 3, 6>::from_fn(|c, p| (slopes[p][i][c] - r[c]) / H);
            a += weight * j.transpose() * j;
            g += weight * j.transpose() * r;
        }
        for p in 0..6 {
            a[(p, p)] += PRIOR.powi(-2);
            g[p] += free[p] * PRIOR.powi(-2);
        }
        let mut gained = 0.0;
        while damping < 1e6 {
            let mut damped = a;
            for p in 0..6 {
                damped[(p, p)] *= 1.0 + damping;
            }
            let Some(step) = damped.cholesky().map(|c| c.solve(&g)) else { break };
            let next: [f64; 6] = std::array::from_fn(|p| (free[p] - step[p]).clamp(LIMITS[0], LIMITS[1]));
            if let Some(there) = residuals(&next) {
                let c = cost(&there, &next);
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
    let without = misfit(&residuals(&[0.0; 6])?);
    let explained = if without > 0.0 { 1.0 - misfit(&r) / without } else { 0.0 };
    let mixing = Mixing::from_free(&free);
    tracing::info!(explained, ?mixing, "cross-talk");
    Some(Estimate { mixing, explained: explained as f32 })
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Mixing = Mixing([[0.83, 0.14, 0.03], [0.10, 0.78, 0.12], [0.02, 0.17, 0.81]]);

    #[test]
    fn back_is_the_inverse_of_forth() {
        let ready = Ready::new(&A).unwrap();
        for flash in [[0.9, 0.2, 0.1], [0.3, 0.3, 0.3], [0.1, 0.15, 0.6]] {
            let flash = A.matrix() * Vector3::from(flash);
            let identity = ready.to_board(flash) * ready.off_board(flash);
            assert!((identity - Matrix3::identity()).abs().max() < 1e-4, "{identity}");
            // White stays white: rows sum to one.
            assert!((ready.off_board(flash) * Vector3::repeat(1.0) - Vector3::repeat(1.0)).abs().max() < 1e-5);
        }
    }

    /// A gray object is measured as the board is, whatever the mixing.
    #[test]
    fn gray_objects_do_not_mix() {
        let ready = Ready::new(&A).unwrap();
        assert!((ready.off_board(Vector3::repeat(0.4)) - Matrix3::identity()).abs().max() < 1e-5);
    }

    /// The formula against the physics it stands for: light through A, object shares, patterns.
    #[test]
    fn a_colored_object_measures_what_the_model_says() {
        let (rho, patterns) = (Vector3::new(0.8f32, 0.3, 0.1), Vector3::new(0.2f32, 0.7, 0.5));
        let a = A.matrix();
        let measured = (a * rho.component_mul(&patterns)).component_div(&(a * rho));
        let found = Ready::new(&A).unwrap().off_board(a * rho) * (a * patterns);
        assert!((measured - found).abs().max() < 1e-5, "{measured} {found}");
    }
}
