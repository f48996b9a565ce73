//! Refining a column to sub-pixel.

use super::codewords::{CodewordTable, centered};

/// Returns the variance of a normalized intensity that noise does not explain: the projected images' eight bits, and,
/// where three images leave no misfit that would tell, what light does besides.
pub(super) fn model_variance(k: usize) -> f32 {
    let sigma: f32 = if k > 3 { 0.0015 } else { 0.005 };
    sigma * sigma
}

/// Refines columns to sub-pixel; holds the memory for that.
pub struct Refiner {
    p: Vec<f32>,
    c: Vec<f32>,
    d: Vec<f32>,
    /// Sum of squares that the last codeword left unexplained.
    pub(super) misfit: f32,
}

impl Refiner {
    /// Returns a refiner of codewords of `k` values.
    pub fn new(k: usize) -> Self {
        Self { p: vec![0.0; k], c: vec![0.0; k], d: vec![0.0; k], misfit: 0.0 }
    }

    /// Returns the column near `start` that explains the codeword `p` best up to scale and offset, and its standard
    /// deviation for intensities of variance `noise`. `None` where the codeword does not change along the columns, or
    /// the scale is not positive.
    #[inline]
    pub fn refine(&mut self, table: &CodewordTable, p: &[f32], start: f32, noise: f32) -> Option<(f32, f32)> {
        let k = p.len();
        centered(p, &mut self.p);
        let mut u = start;
        let mut information = 0.0;
        for _ in 0..4 {
            let (mut mean_c, mut mean_d) = (0.0, 0.0);
            for j in 0..k {
                (self.c[j], self.d[j]) = table.eval(j, u);
                mean_c += self.c[j];
                mean_d += self.d[j];
            }
            (mean_c, mean_d) = (mean_c / k as f32, mean_d / k as f32);
            let (mut cc, mut cp, mut cd, mut pd, mut dd, mut pp) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
            for j in 0..k {
                let (c, d, p) = (self.c[j] - mean_c, self.d[j] - mean_d, self.p[j]);
                cc += c * c;
                cp += c * p;
                cd += c * d;
                pd += p * d;
                dd += d * d;
                pp += p * p;
            }
            if cc < 1e-6 || cp <= 0.0 {
                return None;
            }
            let scale = cp / cc;
            // The derivative less its part along the codeword (which the scale takes up), times the residual.
            information = scale * scale * (dd - cd * cd / cc);
            self.misfit = pp - cp * scale;
            if information < 1e-8 {
                return None;
            }
            let step = scale * (pd - cp * cd / cc) / information;
            u += step.clamp(-0.7, 0.7);
            if (u - start).abs() > 1.5 {
                u = start;
                break;
            }
            if step.abs() < 1e-3 {
                break;
            }
        }
        // What the codeword leaves unexplained, beyond the noise, is error too.
        let variance = if k > 3 { noise.max(self.misfit / (k - 3) as f32) } else { noise };
        Some((u.clamp(-0.5, table.n as f32 - 0.5), (variance / information).sqrt().max(0.02)))
    }
}
