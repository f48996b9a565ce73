//! The fast evaluation of a spline: what every inner loop over camera rays calls.

use super::spline::{slopes, weights};
use super::view::{Lattice, locate};

/// A [`Lattice`] ready to be evaluated at many points. It gives what [`Lattice::eval`] and [`Lattice::eval_along`]
/// give, but for rounding, faster: the four nodes along w of all channels lie side by side in memory and are summed as
/// one vector over (a, b) before w is looked at. More than six channels go the plain way.
#[derive(Clone, Copy, Debug)]
pub struct LatticeEvaluator<'a> {
    lattice: Lattice<'a>,
    /// Values from one node to the next along a and b.
    stride: [usize; 2],
}

impl<'a> LatticeEvaluator<'a> {
    /// Prepares the evaluation of a spline.
    pub fn new(lattice: Lattice<'a>) -> Self {
        let [na, _, nw] = lattice.n_nodes();
        Self { lattice, stride: [nw * lattice.k, na * nw * lattice.k] }
    }

    /// Returns the spline.
    pub fn lattice(&self) -> Lattice<'a> {
        self.lattice
    }

    /// Returns the offset of the first of the 4 × 4 × 4 nodes, and the position in the cell.
    #[inline(always)]
    fn locate(&self, q: [f32; 3]) -> (usize, [f32; 3]) {
        let (cell, position) = locate(self.lattice.cells, q);
        (cell[1] * self.stride[1] + cell[0] * self.stride[0] + cell[2] * self.lattice.k, position)
    }

    /// Evaluates the spline at unit coordinates `q` (clamped to the cube) into `out`, `k` values.
    #[inline]
    pub fn eval(&self, q: [f32; 3], out: &mut [f32]) {
        match self.lattice.k {
            1 => self.eval_n::<4>(q, out),
            2 => self.eval_n::<8>(q, out),
            3 => self.eval_n::<12>(q, out),
            4 => self.eval_n::<16>(q, out),
            5 => self.eval_n::<20>(q, out),
            6 => self.eval_n::<24>(q, out),
            _ => self.lattice.eval(q, out),
        }
    }

    /// Evaluates the spline and its derivative in the direction `dq` at unit coordinates `q` (clamped to the cube),
    /// into `out` and `dout`, `k` values each.
    #[inline]
    pub fn eval_along(&self, q: [f32; 3], dq: [f32; 3], out: &mut [f32], dout: &mut [f32]) {
        match self.lattice.k {
            1 => self.eval_along_n::<4>(q, dq, out, dout),
            2 => self.eval_along_n::<8>(q, dq, out, dout),
            3 => self.eval_along_n::<12>(q, dq, out, dout),
            4 => self.eval_along_n::<16>(q, dq, out, dout),
            5 => self.eval_along_n::<20>(q, dq, out, dout),
            6 => self.eval_along_n::<24>(q, dq, out, dout),
            _ => self.lattice.eval_along(q, dq, out, dout),
        }
    }

    /// Evaluates for N = 4 k.
    #[inline(always)]
    fn eval_n<const N: usize>(&self, q: [f32; 3], out: &mut [f32]) {
        let (base, position) = self.locate(q);
        let [wa, wb, ww] = position.map(weights);
        let mut sum = [0.0f32; N];
        for j in 0..4 {
            for i in 0..4 {
                let at = base + j * self.stride[1] + i * self.stride[0];
                let nodes: &[f32; N] = self.lattice.nodes[at..at + N].try_into().expect("N nodes");
                let ab = wa[i] * wb[j];
                for l in 0..N {
                    sum[l] += ab * nodes[l];
                }
            }
        }
        let k = N / 4;
        for c in 0..k {
            out[c] = ww[0] * sum[c] + ww[1] * sum[k + c] + ww[2] * sum[2 * k + c] + ww[3] * sum[3 * k + c];
        }
    }

    /// Evaluates with the derivative, for N = 4 k.
    #[inline(always)]
    fn eval_along_n<const N: usize>(&self, q: [f32; 3], dq: [f32; 3], out: &mut [f32], dout: &mut [f32]) {
        let (base, position) = self.locate(q);
        let [wa, wb, ww] = position.map(weights);
        let mut d = position.map(slopes);
        for i in 0..3 {
            let scale = dq[i] * self.lattice.cells[i] as f32;
            d[i].iter_mut().for_each(|s| *s *= scale);
        }
        let (mut sum, mut dsum) = ([0.0f32; N], [0.0f32; N]);
        for j in 0..4 {
            for i in 0..4 {
                let at = base + j * self.stride[1] + i * self.stride[0];
                let nodes: &[f32; N] = self.lattice.nodes[at..at + N].try_into().expect("N nodes");
                let ab = wa[i] * wb[j];
                let dab = d[0][i] * wb[j] + wa[i] * d[1][j];
                for l in 0..N {
                    sum[l] += ab * nodes[l];
                    dsum[l] += dab * nodes[l];
                }
            }
        }
        let k = N / 4;
        for c in 0..k {
            let (mut v, mut s) = (0.0, 0.0);
            for l in 0..4 {
                v += ww[l] * sum[l * k + c];
                s += ww[l] * dsum[l * k + c] + d[2][l] * sum[l * k + c];
            }
            out[c] = v;
            dout[c] = s;
        }
    }
}
