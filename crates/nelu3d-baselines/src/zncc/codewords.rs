//! Codewords, measured and projected, and how they are compared.

use rayon::prelude::*;

use super::blurred::blurred;
use crate::captured::Captured;
use crate::code::AxisCode;

/// The normalized intensities of every pixel in all images, `n × k`.
pub(super) struct SeenCodewords {
    pub(super) k: usize,
    /// Normalized intensities.
    p: Vec<f32>,
}

impl SeenCodewords {
    pub(super) fn new(captured: &Captured, planes: &[(usize, usize)]) -> Self {
        let k = planes.len();
        let mut p = vec![0.0; captured.status.len() * k];
        p.par_chunks_mut(k).enumerate().for_each(|(i, out)| {
            for (v, (plane, _)) in out.iter_mut().zip(planes) {
                *v = captured.planes[*plane].p[i];
            }
        });
        Self { k, p }
    }

    pub(super) fn at(&self, i: usize) -> &[f32] {
        &self.p[i * self.k..(i + 1) * self.k]
    }
}

/// The codewords of all columns: k values of light each.
pub struct CodewordTable {
    /// Columns.
    pub(super) n: usize,
    /// Light, k lines of n columns.
    lines: Vec<Vec<f32>>,
    /// The lines less their mean and divided by the norm: zero where a column has no contrast.
    normalized: Vec<Vec<f32>>,
}

impl CodewordTable {
    /// Makes the table of the lines of a code, blurred by a Gaussian of standard deviation `blur_px`. `planes` says
    /// which lines, in the codewords' order: the second number of each pair. The first is the captures' plane it is
    /// seen in, and does not matter here.
    pub fn new(axis: &AxisCode, planes: &[(usize, usize)], blur_px: f32) -> Self {
        let lines: Vec<Vec<f32>> = planes.iter().map(|(_, l)| blurred(&axis.lines[*l].values, blur_px)).collect();
        let (n, k) = (axis.len(), lines.len() as f32);
        let mut normalized = lines.clone();
        for u in 0..n {
            let mean = lines.iter().map(|l| l[u]).sum::<f32>() / k;
            let norm = lines.iter().map(|l| (l[u] - mean).powi(2)).sum::<f32>().sqrt();
            for line in &mut normalized {
                line[u] = if norm > 1e-3 { (line[u] - mean) / norm } else { 0.0 };
            }
        }
        Self { n, lines, normalized }
    }

    /// Writes the correlations of a centered codeword with columns `low..=high` to `out`. They are not divided by the
    /// codeword's own norm.
    ///
    /// # Panics
    ///
    /// If there are no such columns.
    #[inline]
    pub fn correlate(&self, centered: &[f32], low: usize, high: usize, out: &mut Vec<f32>) {
        out.clear();
        out.resize(high - low + 1, 0.0);
        for (c, line) in centered.iter().zip(&self.normalized) {
            for (o, t) in out.iter_mut().zip(&line[low..=high]) {
                *o += c * t;
            }
        }
    }

    /// Returns value `j` of the codeword at column `u`, which may lie between two, and its derivative along the columns
    /// (Catmull–Rom).
    #[inline]
    pub fn eval(&self, j: usize, u: f32) -> (f32, f32) {
        let line = &self.lines[j];
        let u = u.clamp(0.0, (self.n - 1) as f32);
        let i = (u as usize).min(self.n.saturating_sub(2));
        let f = u - i as f32;
        let at = |k: usize| line[k.min(self.n - 1)];
        let (a, b, c, d) = (at(i.saturating_sub(1)), at(i), at(i + 1), at(i + 2));
        let (m, o) = (0.5 * (c - a), 0.5 * (d - b));
        let (p, q) = (2.0 * (b - c) + m + o, 3.0 * (c - b) - 2.0 * m - o);
        (b + f * (m + f * (q + f * p)), m + f * (2.0 * q + 3.0 * f * p))
    }
}

/// Writes a codeword less its mean to `out`, of the same length, and returns the norm of that.
#[inline]
pub fn centered(p: &[f32], out: &mut [f32]) -> f32 {
    let mean = p.iter().sum::<f32>() / p.len() as f32;
    let mut square = 0.0;
    for (o, v) in out.iter_mut().zip(p) {
        *o = v - mean;
        square += *o * *o;
    }
    square.sqrt()
}

/// Returns the index of the largest score, and that score; (0, −∞) of none.
pub fn largest(scores: &[f32]) -> (usize, f32) {
    let mut best = (0, f32::NEG_INFINITY);
    for (i, s) in scores.iter().enumerate() {
        if *s > best.1 {
            best = (i, *s);
        }
    }
    best
}
