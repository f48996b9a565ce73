//! The fast evaluation of a spline: what every inner loop over camera rays calls.

use pulp::{Arch, Simd, WithSimd};

use super::lanes::mul_add;
use super::spline::{slopes, weights};
use super::view::{Lattice, locate};

/// Channels that are summed side by side where there are as many.
const CHANNELS: usize = 8;

/// A [`Lattice`] ready to be evaluated at many points. It gives what [`Lattice::eval`] and [`Lattice::eval_along`]
/// give, but for rounding, faster: the four nodes along w of all channels lie side by side in memory and are summed as
/// one vector over (a, b) before w is looked at. Of eight channels or more, eight at a time are summed over all nodes.
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
            7 => self.eval_n::<28>(q, out),
            _ => {
                let (base, position) = self.locate(q);
                let weights = products(position.map(weights));
                Arch::new().dispatch(OfMany { of: self, base, terms: [(weights, out)] });
            }
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
            7 => self.eval_along_n::<28>(q, dq, out, dout),
            _ => {
                let (base, position) = self.locate(q);
                let w = position.map(weights);
                let mut along = [0.0; 64];
                for axis in 0..3 {
                    let (mut of_axis, scale) = (w, dq[axis] * self.lattice.cells[axis] as f32);
                    of_axis[axis] = slopes(position[axis]).map(|s| scale * s);
                    along.iter_mut().zip(products(of_axis)).for_each(|(sum, v)| *sum += v);
                }
                Arch::new().dispatch(OfMany { of: self, base, terms: [(products(w), out), (along, dout)] });
            }
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

/// Returns the weights of the 64 nodes around a point, `[b][a][w]`.
#[inline(always)]
fn products([a, b, w]: [[f32; 4]; 3]) -> [f32; 64] {
    std::array::from_fn(|n| a[n / 4 % 4] * b[n / 16] * w[n % 4])
}

/// Sums over the nodes around a point, of eight channels or more.
struct OfMany<'a, 'b, const T: usize> {
    of: &'a LatticeEvaluator<'b>,
    /// Offset of the first node.
    base: usize,
    /// Weights of the nodes, and where their sums go.
    terms: [([f32; 64], &'a mut [f32]); T],
}

impl<const T: usize> WithSimd for OfMany<'_, '_, T> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { of, base, terms } = self;
        let (k, nodes) = (of.lattice.k, of.lattice.nodes);
        for c in (0..k).step_by(CHANNELS) {
            // The last vector begins before the end of the one before it.
            let c = c.min(k - CHANNELS);
            let mut sums = [[0.0f32; CHANNELS]; T];
            for n in 0..16 {
                let row = &nodes[base + n / 4 * of.stride[1] + n % 4 * of.stride[0] + c..][..3 * k + CHANNELS];
                for l in 0..4 {
                    let node: &[f32; CHANNELS] = row[l * k..].first_chunk().expect("channels of a node");
                    for t in 0..T {
                        let weight = terms[t].0[4 * n + l];
                        for i in 0..CHANNELS {
                            sums[t][i] = mul_add::<S>(weight, node[i], sums[t][i]);
                        }
                    }
                }
            }
            for t in 0..T {
                terms[t].1[c..c + CHANNELS].copy_from_slice(&sums[t]);
            }
        }
    }
}
