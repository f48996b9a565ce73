//! The `grid` form: a cubic B-spline over the unit cube of a [`FieldFrame`](super::frame::FieldFrame), fitted by least squares.

use rayon::prelude::*;

/// A uniform tricubic B-spline of `k` channels on `[0, 1]^3`. Nodes are stored `[b][a][w][k]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Cells along a, b and w.
    pub cells: [usize; 3],
    /// Channels.
    pub k: usize,
    /// `(cells_b + 3) × (cells_a + 3) × (cells_w + 3) × k` coefficients.
    pub coeffs: Vec<f32>,
}

/// Uniform cubic B-spline weights at `f` in `[0, 1]`.
#[inline(always)]
pub(crate) fn weights(f: f32) -> [f32; 4] {
    let g = 1.0 - f;
    let (f2, g2) = (f * f, g * g);
    // Products instead of quotients: this is evaluated for every sample of every step of a fit.
    const SIXTH: f32 = 1.0 / 6.0;
    [g2 * g * SIXTH, (4.0 - f2 * (6.0 - 3.0 * f)) * SIXTH, (4.0 - g2 * (6.0 - 3.0 * g)) * SIXTH, f2 * f * SIXTH]
}

/// Their derivatives by `f`.
#[inline(always)]
fn slopes(f: f32) -> [f32; 4] {
    let g = 1.0 - f;
    [-0.5 * g * g, 0.5 * f * (3.0 * f - 4.0), -0.5 * g * (3.0 * g - 4.0), 0.5 * f * f]
}

impl Grid {
    /// A grid of zeros.
    pub fn new(cells: [usize; 3], k: usize) -> Self {
        let n: usize = cells.iter().map(|c| c + 3).product();
        Self { cells, k, coeffs: vec![0.0; n * k] }
    }

    /// Nodes along a, b and w.
    pub fn nodes(&self) -> [usize; 3] {
        self.cells.map(|c| c + 3)
    }

    #[inline(always)]
    fn locate(&self, q: [f32; 3]) -> ([usize; 3], [f32; 3]) {
        Self::locate_in(self.cells, q)
    }

    /// The cell that holds `q` (clamped to the cube), and where in it.
    #[inline(always)]
    pub(crate) fn locate_in(cells: [usize; 3], q: [f32; 3]) -> ([usize; 3], [f32; 3]) {
        let mut cell = [0; 3];
        let mut frac = [0.0; 3];
        for i in 0..3 {
            let n = cells[i];
            let u = (q[i] * n as f32).clamp(0.0, n as f32);
            // Through i32, which the processor converts to directly.
            cell[i] = (u as i32 as usize).min(n - 1);
            frac[i] = u - cell[i] as f32;
        }
        (cell, frac)
    }

    /// c at unit coordinates `q` (clamped to the cube), into `out` (k values).
    #[inline]
    pub fn eval(&self, q: [f32; 3], out: &mut [f32]) {
        match self.k {
            1 => self.eval_k::<1>(q, out),
            2 => self.eval_k::<2>(q, out),
            3 => self.eval_k::<3>(q, out),
            4 => self.eval_k::<4>(q, out),
            _ => self.eval_any(q, out),
        }
    }

    fn eval_any(&self, q: [f32; 3], out: &mut [f32]) {
        out.fill(0.0);
        let k = self.k;
        self.visit(q, |base, w| {
            for (o, c) in out.iter_mut().zip(&self.coeffs[base..base + k]) {
                *o += w * c;
            }
        });
    }

    #[inline]
    fn eval_k<const K: usize>(&self, q: [f32; 3], out: &mut [f32]) {
        let mut acc = [0.0f32; K];
        let (cell, frac) = self.locate(q);
        let [wa, wb, ww] = frac.map(weights);
        let [na, _, nw] = self.nodes();
        for (j, wb) in wb.iter().enumerate() {
            for (i, wa) in wa.iter().enumerate() {
                let base = (((cell[1] + j) * na + cell[0] + i) * nw + cell[2]) * K;
                let node = &self.coeffs[base..base + 4 * K];
                let ab = wa * wb;
                for (l, ww) in ww.iter().enumerate() {
                    let w = ab * ww;
                    for c in 0..K {
                        acc[c] += w * node[l * K + c];
                    }
                }
            }
        }
        out[..K].copy_from_slice(&acc);
    }

    /// c and its derivative in the direction `dq`, into `out` and `dout` (k values each).
    pub fn eval_along(&self, q: [f32; 3], dq: [f32; 3], out: &mut [f32], dout: &mut [f32]) {
        out.fill(0.0);
        dout.fill(0.0);
        let k = self.k;
        let (cell, frac) = self.locate(q);
        let [wa, wb, ww] = frac.map(weights);
        let mut d = frac.map(slopes);
        for i in 0..3 {
            let scale = dq[i] * self.cells[i] as f32;
            d[i].iter_mut().for_each(|s| *s *= scale);
        }
        let [na, _, nw] = self.nodes();
        for j in 0..4 {
            for i in 0..4 {
                let base = (((cell[1] + j) * na + cell[0] + i) * nw + cell[2]) * k;
                let ab = wa[i] * wb[j];
                let dab = d[0][i] * wb[j] + wa[i] * d[1][j];
                for l in 0..4 {
                    let w = ab * ww[l];
                    let dw = dab * ww[l] + ab * d[2][l];
                    let node = &self.coeffs[base + l * k..base + (l + 1) * k];
                    for c in 0..k {
                        out[c] += w * node[c];
                        dout[c] += dw * node[c];
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn visit(&self, q: [f32; 3], mut f: impl FnMut(usize, f32)) {
        let (cell, frac) = self.locate(q);
        let [wa, wb, ww] = frac.map(weights);
        let [na, _, nw] = self.nodes();
        for (j, wb) in wb.iter().enumerate() {
            for (i, wa) in wa.iter().enumerate() {
                let base = ((cell[1] + j) * na + cell[0] + i) * nw + cell[2];
                for (l, ww) in ww.iter().enumerate() {
                    f((base + l) * self.k, wa * wb * ww);
                }
            }
        }
    }

    /// Sets the coefficients so that the spline passes through `values` at its nodes (`[b][a][w][k]`), by Richardson
    /// iteration on the node-to-node smoothing of the spline, which is a contraction.
    pub fn interpolate(&mut self, values: &[f32]) {
        assert_eq!(values.len(), self.coeffs.len());
        self.coeffs.copy_from_slice(values);
        for _ in 0..5 {
            let smooth = self.resampled(self.cells);
            for (c, (v, s)) in self.coeffs.iter_mut().zip(values.iter().zip(&smooth.coeffs)) {
                *c += v - s;
            }
        }
    }

    /// The same function on a grid with other numbers of cells (sampled at the new nodes; a start for a fit).
    pub fn resampled(&self, cells: [usize; 3]) -> Self {
        let mut out = Self::new(cells, self.k);
        let [na, _, nw] = out.nodes();
        let k = self.k;
        out.coeffs.par_chunks_mut(na * nw * k).enumerate().for_each(|(b, row)| {
            for a in 0..na {
                for w in 0..nw {
                    let at = |i: usize, n: usize| (i as f32 - 1.0) / n as f32;
                    let q = [at(a, cells[0]), at(b, cells[1]), at(w, cells[2])];
                    self.eval(q, &mut row[(a * nw + w) * k..][..k]);
                }
            }
        });
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spline_weights_sum_to_one_and_their_slopes_to_zero() {
        for i in 0..=10 {
            let f = i as f32 / 10.0;
            assert!((weights(f).iter().sum::<f32>() - 1.0).abs() < 1e-6);
            assert!(slopes(f).iter().sum::<f32>().abs() < 1e-6);
            let h = 1e-2;
            let (hi, lo) = (weights(f + h), weights(f - h));
            for j in 0..4 {
                assert!(((hi[j] - lo[j]) / (2.0 * h) - slopes(f)[j]).abs() < 1e-3);
            }
        }
    }
}
