//! The nodes of a spline, and its plain evaluation.

use super::spline::{slopes, weights_by_product};

/// A uniform tricubic B-spline of `k` channels on the unit cube, with coordinates (a, b, w).
#[derive(Clone, Copy, Debug)]
pub struct Lattice<'a> {
    /// Cells along a, b and w.
    pub cells: [usize; 3],
    /// Number of channels.
    pub k: usize,
    /// Coefficients `[b][a][w][k]`. Along each axis there are three nodes more than cells, one before the first cell
    /// and two behind the last.
    pub nodes: &'a [f32],
}

/// Returns the cell that holds the unit coordinates `q` (clamped to the cube), and the position in it, in `[0, 1]`.
#[inline(always)]
pub fn locate(cells: [usize; 3], q: [f32; 3]) -> ([usize; 3], [f32; 3]) {
    let mut cell = [0; 3];
    let mut position = [0.0; 3];
    for i in 0..3 {
        let n = cells[i];
        let u = (q[i] * n as f32).clamp(0.0, n as f32);
        // Through i32, which the processor converts to directly.
        cell[i] = (u as i32 as usize).min(n - 1);
        position[i] = u - cell[i] as f32;
    }
    (cell, position)
}

impl Lattice<'_> {
    /// Returns the number of nodes along a, b and w.
    #[inline]
    pub fn n_nodes(&self) -> [usize; 3] {
        self.cells.map(|c| c + 3)
    }

    /// Checks that there are cells and channels, and as many coefficients as their numbers ask for.
    ///
    /// # Panics
    /// If not.
    pub fn check(&self) {
        assert!(self.k > 0 && self.cells.iter().all(|c| *c > 0));
        assert_eq!(self.nodes.len(), self.n_nodes().iter().product::<usize>() * self.k);
    }

    /// Evaluates the spline at unit coordinates `q` (clamped to the cube) into `out`, `k` values.
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
        let k = self.k;
        let (cell, position) = locate(self.cells, q);
        let [wa, wb, ww] = position.map(weights_by_product);
        let [na, _, nw] = self.n_nodes();
        out.fill(0.0);
        for (j, wb) in wb.iter().enumerate() {
            for (i, wa) in wa.iter().enumerate() {
                let base = ((cell[1] + j) * na + cell[0] + i) * nw + cell[2];
                for (l, ww) in ww.iter().enumerate() {
                    let w = wa * wb * ww;
                    for (o, c) in out.iter_mut().zip(&self.nodes[(base + l) * k..][..k]) {
                        *o += w * c;
                    }
                }
            }
        }
    }

    #[inline]
    fn eval_k<const K: usize>(&self, q: [f32; 3], out: &mut [f32]) {
        let mut acc = [0.0f32; K];
        let (cell, position) = locate(self.cells, q);
        let [wa, wb, ww] = position.map(weights_by_product);
        let [na, _, nw] = self.n_nodes();
        for (j, wb) in wb.iter().enumerate() {
            for (i, wa) in wa.iter().enumerate() {
                let base = (((cell[1] + j) * na + cell[0] + i) * nw + cell[2]) * K;
                let node = &self.nodes[base..base + 4 * K];
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

    /// Evaluates the spline and its derivative in the direction `dq` at unit coordinates `q` (clamped to the cube),
    /// into `out` and `dout`, `k` values each.
    pub fn eval_along(&self, q: [f32; 3], dq: [f32; 3], out: &mut [f32], dout: &mut [f32]) {
        out.fill(0.0);
        dout.fill(0.0);
        let k = self.k;
        let (cell, position) = locate(self.cells, q);
        let [wa, wb, ww] = position.map(weights_by_product);
        let mut d = position.map(slopes);
        for i in 0..3 {
            let scale = dq[i] * self.cells[i] as f32;
            d[i].iter_mut().for_each(|s| *s *= scale);
        }
        let [na, _, nw] = self.n_nodes();
        for j in 0..4 {
            for i in 0..4 {
                let base = (((cell[1] + j) * na + cell[0] + i) * nw + cell[2]) * k;
                let ab = wa[i] * wb[j];
                let dab = d[0][i] * wb[j] + wa[i] * d[1][j];
                for l in 0..4 {
                    let w = ab * ww[l];
                    let dw = dab * ww[l] + ab * d[2][l];
                    let node = &self.nodes[base + l * k..base + (l + 1) * k];
                    for c in 0..k {
                        out[c] += w * node[c];
                        dout[c] += dw * node[c];
                    }
                }
            }
        }
    }
}
