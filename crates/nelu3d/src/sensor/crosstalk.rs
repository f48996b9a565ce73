//! Crosstalk: a camera's red, green and blue each respond to some of the light's other colors.
//!
//! A light source sends three colors, each with its own pattern c′_m(x). The board returns all alike, so on it channel
//! i measures `c_i = Σ_m A_im c′_m`, with rows of A that sum to one: c is the color field, as it was learned. A colored
//! object returns the fraction ρ_m of each, and channel i measures `p_i = Σ_m A_im ρ_m c′_m / Σ_m A_im ρ_m`: another
//! combination, which no point of the field explains (a failure in the paper's Fig. 8). But its white (flash) image,
//! with c′ = 1 everywhere, is `W_i ∝ Σ_m A_im ρ_m` (relative to the board's), so ρ = A⁻¹ W is known at every pixel once
//! A is; and p is taken back to what the board would have shown there: `c = A diag(1/ρ) A⁻¹ diag(Aρ) p`.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::measurements::Measurements;
use crate::surface::PixelStatus;

/// The crosstalk matrix A of a camera and a light source with three colors: rows are the camera's channels and sum to
/// one, columns are the light's colors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CrosstalkMatrix(pub [[f32; 3]; 3]);

/// Smallest fraction of a color relative to the largest: a surface returns some of every color.
const MIN_FRACTION: f32 = 0.02;

impl CrosstalkMatrix {
    /// The identity: no crosstalk.
    pub const NONE: Self = Self([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);

    /// Returns the largest absolute difference of an entry.
    pub fn difference(&self, other: &Self) -> f32 {
        self.0.iter().flatten().zip(other.0.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    /// Makes the matrix from its six off-diagonal entries, row by row.
    pub(crate) fn from_free(free: &[f64; 6]) -> Self {
        let [a, b, c, d, e, f] = free.map(|v| v as f32);
        Self([[1.0 - a - b, a, b], [c, 1.0 - c - d, d], [e, f, 1.0 - e - f]])
    }

    /// Returns the six off-diagonal entries, row by row; the diagonal follows because rows sum to one.
    pub(crate) fn free(&self) -> [f64; 6] {
        let m = &self.0;
        [m[0][1], m[0][2], m[1][0], m[1][2], m[2][0], m[2][1]].map(f64::from)
    }

    /// Returns it as a matrix that acts on a pixel's channels.
    pub fn matrix(&self) -> Matrix3<f32> {
        Matrix3::from_fn(|i, j| self.0[i][j])
    }
}

/// A crosstalk matrix with its inverse, prepared for many pixels.
pub struct CrosstalkCorrection {
    a: Matrix3<f32>,
    inverse: Matrix3<f32>,
}

impl CrosstalkCorrection {
    /// Inverts a matrix; `None` if it is singular.
    pub fn new(crosstalk: &CrosstalkMatrix) -> Option<Self> {
        let a = crosstalk.matrix();
        Some(Self { a, inverse: a.try_inverse()? })
    }

    /// Returns the fraction ρ of each of the light's colors that a pixel returns, largest 1, from its white relative to
    /// the board's.
    fn color_fractions(&self, white: Vector3<f32>) -> Vector3<f32> {
        let rho = self.inverse * white;
        let max = rho.max().max(1e-6);
        rho.map(|v| (v / max).max(MIN_FRACTION))
    }

    /// Returns the matrix that takes a codeword of the field to that of an object with this white relative to the
    /// board's.
    pub fn object_from_board(&self, white: Vector3<f32>) -> Matrix3<f32> {
        let rho = self.color_fractions(white);
        let total = self.a * rho;
        let object = self.a * Matrix3::from_diagonal(&rho) * self.inverse;
        Matrix3::from_fn(|i, j| object[(i, j)] / total[i])
    }

    /// Returns the inverse of [`Self::object_from_board`].
    pub fn board_from_object(&self, white: Vector3<f32>) -> Matrix3<f32> {
        let rho = self.color_fractions(white);
        self.a * Matrix3::from_diagonal(&rho.map(|v| 1.0 / v)) * self.inverse * Matrix3::from_diagonal(&(self.a * rho))
    }
}

/// Returns white − black of pixel `i` relative to that of the board, per channel.
pub fn relative_white(m: &Measurements, i: usize, board: &[f32; 3]) -> Vector3<f32> {
    Vector3::from_fn(|c, _| m.light[i * 3 + c] / board[c])
}

impl Measurements {
    /// Takes every codeword back to what the board would have shown. `board` is white − black of the board, per
    /// channel.
    pub fn correct_crosstalk(&mut self, crosstalk: &CrosstalkMatrix, board: &[f32; 3]) {
        let Some(correction) = CrosstalkCorrection::new(crosstalk) else { return };
        let (k, n) = (self.k, self.n());
        for i in 0..n {
            if self.status[i] != PixelStatus::Valid {
                continue;
            }
            let back = correction.board_from_object(relative_white(self, i, board));
            for image in 0..k / 3 {
                let at = i * k + 3 * image;
                let p = Vector3::from_fn(|c, _| self.p[at + c]);
                let inv_var = Vector3::from_fn(|c, _| self.inv_var[at + c]);
                for c in 0..3 {
                    let row = back.row(c);
                    let mut variance = 0.0;
                    for j in 0..3 {
                        // An unusable channel carries no information, and neither do those that depend on it.
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
