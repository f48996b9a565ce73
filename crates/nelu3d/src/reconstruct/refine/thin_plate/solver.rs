//! The solver of the linear system: conjugate gradients with a diagonal preconditioner.

use rayon::prelude::*;

use super::operator::{BLOCK, Scratch};
use super::prior::ThinPlatePrior;
use super::row_sums::{dot, weighted_square};

/// The criterion by which the solver stops: whichever of the two is reached first.
#[derive(Clone, Copy, Debug)]
pub(in crate::reconstruct::refine) struct StopCriterion {
    /// Factor by which the residual (in the preconditioner's norm) is reduced.
    pub(in crate::reconstruct::refine) reduction: f64,
    /// Largest number of iterations.
    pub(in crate::reconstruct::refine) iterations: usize,
}

impl ThinPlatePrior {
    /// Solves (diag(h) + DᵀWD) x = b from the given start, which must be 0 where there is no surface. Returns the
    /// number of iterations.
    pub(in crate::reconstruct::refine) fn solve(
        &self,
        h: &[f32],
        b: &[f32],
        x: &mut [f32],
        until: StopCriterion,
    ) -> usize {
        let (w, n) = (self.width, x.len());
        let rows = BLOCK * w;
        let inverse = self.inverse_diagonal(h);
        let mut scratch: Vec<Scratch> = (0..self.height.div_ceil(BLOCK)).map(|_| self.scratch()).collect();
        let mut ap = vec![0.0f32; n];
        let apply = |x: &[f32], y: &mut [f32], scratch: &mut [Scratch]| -> f64 {
            let sums: Vec<f64> = y
                .par_chunks_mut(rows)
                .zip(scratch)
                .enumerate()
                .map(|(block, (y, scratch))| self.apply_block(block, h, x, scratch, y))
                .collect();
            sums.iter().sum()
        };
        apply(x, &mut ap, &mut scratch);
        let mut r: Vec<f32> = (0..n).map(|i| if self.active[i] { b[i] - ap[i] } else { 0.0 }).collect();
        let mut p: Vec<f32> = r.iter().zip(&inverse).map(|(r, d)| r * d).collect();
        let first: f64 = r.chunks(w).zip(p.chunks(w)).map(|(r, p)| dot(r, p)).sum();
        let mut rz = first;
        for iteration in 0..until.iterations {
            if rz <= until.reduction * until.reduction * first {
                return iteration;
            }
            let pap = apply(&p, &mut ap, &mut scratch);
            let step = if pap > 0.0 { (rz / pap) as f32 } else { 0.0 };
            let sums: Vec<f64> = x
                .par_chunks_mut(rows)
                .zip(r.par_chunks_mut(rows))
                .zip(p.par_chunks(rows).zip(ap.par_chunks(rows)))
                .zip(inverse.par_chunks(rows))
                .map(|(((x, r), (p, ap)), inverse)| {
                    for (((x, r), p), ap) in x.iter_mut().zip(&mut *r).zip(p).zip(ap) {
                        *x += step * p;
                        *r -= step * ap;
                    }
                    r.chunks(w).zip(inverse.chunks(w)).map(|(r, inverse)| weighted_square(r, inverse)).sum()
                })
                .collect();
            let next: f64 = sums.iter().sum();
            let beta = if rz > 0.0 { (next / rz) as f32 } else { 0.0 };
            p.par_chunks_mut(rows).zip(r.par_chunks(rows)).zip(inverse.par_chunks(rows)).for_each(
                |((p, r), inverse)| {
                    for ((p, r), inverse) in p.iter_mut().zip(r).zip(inverse) {
                        *p = r * inverse + beta * *p;
                    }
                },
            );
            rz = next;
        }
        until.iterations
    }
}
