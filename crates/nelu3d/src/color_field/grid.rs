//! The `grid` form: a cubic B-spline over the unit cube of a [`Frame`](super::frame::Frame), fitted by least squares.

use rayon::prelude::*;

use crate::progress::Progress;

/// Rows of cells that one task of the adjoint owns; neighbors of the same parity never touch the same nodes.
const STRIPE: usize = 16;

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
fn weights(f: f32) -> [f32; 4] {
    let g = 1.0 - f;
    let (f2, g2) = (f * f, g * g);
    [g2 * g / 6.0, (4.0 - f2 * (6.0 - 3.0 * f)) / 6.0, (4.0 - g2 * (6.0 - 3.0 * g)) / 6.0, f2 * f / 6.0]
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
        let mut cell = [0; 3];
        let mut frac = [0.0; 3];
        for i in 0..3 {
            let n = self.cells[i];
            let u = (q[i] * n as f32).clamp(0.0, n as f32);
            cell[i] = (u as usize).min(n - 1);
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

/// Samples of the field gathered in small bins: memory depends on the volume and its resolution, not on how many board
/// positions there were. A bin keeps the weighted mean of its samples' coordinates and values, so it acts as one sample
/// at their centroid.
pub struct Bins {
    counts: [usize; 3],
    k: usize,
    /// Per bin: Σω̄, Σω̄ q (3), then per channel Σω, Σω L.
    sums: Vec<f32>,
}

impl Bins {
    /// Empty bins over the unit cube, `counts` along a, b and w.
    pub fn new(counts: [usize; 3], k: usize) -> Self {
        Self { counts, k, sums: vec![0.0; counts.iter().product::<usize>() * (4 + 2 * k)] }
    }

    fn stride(&self) -> usize {
        4 + 2 * self.k
    }

    /// Adds one sample: unit coordinates, k values, k weights (0 = that channel is missing).
    pub fn add(&mut self, q: [f32; 3], values: &[f32], omegas: &[f32]) {
        let mut cell = [0; 3];
        for i in 0..3 {
            if !(0.0..=1.0).contains(&q[i]) {
                return;
            }
            cell[i] = ((q[i] * self.counts[i] as f32) as usize).min(self.counts[i] - 1);
        }
        let mean = omegas.iter().sum::<f32>() / self.k as f32;
        if mean <= 0.0 {
            return;
        }
        let stride = self.stride();
        let at = ((cell[1] * self.counts[0] + cell[0]) * self.counts[2] + cell[2]) * stride;
        let bin = &mut self.sums[at..at + stride];
        // Coordinates relative to the bin's center: a float sum of hundreds of nearly equal numbers would lose them.
        bin[0] += mean;
        for i in 0..3 {
            bin[1 + i] += mean * (q[i] * self.counts[i] as f32 - cell[i] as f32 - 0.5);
        }
        for (j, (v, w)) in values.iter().zip(omegas).enumerate() {
            bin[4 + 2 * j] += w;
            bin[5 + 2 * j] += w * v;
        }
    }

    /// Calls `f(q, values, weights)` for every sample that the bins stand for.
    pub fn for_each_sample(&self, mut f: impl FnMut([f32; 3], &[f32], &[f32])) {
        let (mut values, mut omegas) = (vec![0.0; self.k], vec![0.0; self.k]);
        for s in self.rows().iter().flatten() {
            for c in 0..self.k {
                let [w, wv] = [self.sums[s.at + 2 * c], self.sums[s.at + 2 * c + 1]];
                omegas[c] = w;
                values[c] = if w > 0.0 { wv / w } else { 0.0 };
            }
            f(s.q, &values, &omegas);
        }
    }

    /// The samples that the bins stand for, grouped by row of bins along b.
    fn rows(&self) -> Vec<Vec<Sample>> {
        let per_row = self.counts[0] * self.counts[2] * self.stride();
        self.sums
            .par_chunks(per_row)
            .enumerate()
            .map(|(b, row)| {
                let mut out = Vec::new();
                for (i, bin) in row.chunks_exact(self.stride()).enumerate() {
                    if bin[0] <= 0.0 {
                        continue;
                    }
                    let cell = [i / self.counts[2], b, i % self.counts[2]];
                    let q =
                        std::array::from_fn(|i| (cell[i] as f32 + 0.5 + bin[1 + i] / bin[0]) / self.counts[i] as f32);
                    out.push(Sample { q, at: (b * self.counts[0] * self.counts[2] + i) * self.stride() + 4 });
                }
                out
            })
            .collect()
    }
}

/// A filled bin: where its samples' centroid is, and where its channel sums are.
struct Sample {
    q: [f32; 3],
    at: usize,
}

/// How smooth the spline is where samples do not say otherwise, as a share of a typical node's sample weight.
#[derive(Clone, Copy, Debug)]
pub struct Smoothness {
    /// Across (a, b).
    pub across: f32,
    /// Along w.
    pub along: f32,
}

/// Fits the spline to the binned samples by weighted least squares with a small second-difference penalty: conjugate
/// gradients with a diagonal preconditioner, started from `grid`'s present coefficients. Deterministic for any number of
/// threads.
pub fn fit(grid: &mut Grid, bins: &Bins, smooth: Smoothness, iterations: usize, progress: &Progress) {
    let k = grid.k;
    assert_eq!(k, bins.k);
    // Rows of bins are handed out by the row of cells that they lie in.
    let mut stripes: Vec<Vec<Sample>> = Vec::new();
    stripes.resize_with(grid.cells[1].div_ceil(STRIPE), Vec::new);
    for row in bins.rows() {
        for s in row {
            let cell = ((s.q[1] * grid.cells[1] as f32) as usize).min(grid.cells[1] - 1);
            stripes[cell / STRIPE].push(s);
        }
    }

    let n = grid.coeffs.len();
    let mut diag = vec![0.0f32; n];
    scatter(grid, &stripes, &mut diag, |s, w, node| {
        for c in 0..k {
            node[c] += w * w * bins.sums[s.at + 2 * c];
        }
    });
    let mut rhs = vec![0.0f32; n];
    scatter(grid, &stripes, &mut rhs, |s, w, node| {
        for c in 0..k {
            node[c] += w * bins.sums[s.at + 2 * c + 1];
        }
    });
    // The typical node's weight sets the scale of the penalty, channel by channel.
    let lambda: Vec<f32> = (0..k)
        .map(|c| {
            let (mut sum, mut count) = (0.0f64, 0u64);
            for d in diag.iter().skip(c).step_by(k) {
                if *d > 0.0 {
                    sum += f64::from(*d);
                    count += 1;
                }
            }
            if count > 0 { (sum / count as f64) as f32 } else { 1.0 }
        })
        .collect();
    for (i, d) in diag.iter_mut().enumerate() {
        let l = lambda[i % k];
        *d += 6.0 * l * (2.0 * smooth.across + smooth.along) + 1e-6 * l;
    }

    let apply = |x: &Grid, y: &mut Vec<f32>| {
        y.fill(0.0);
        normal_product(x, &stripes, bins, y);
        penalty(x, smooth, &lambda, y);
    };

    let mut ax = vec![0.0f32; n];
    apply(grid, &mut ax);
    let mut r: Vec<f32> = rhs.iter().zip(&ax).map(|(b, a)| b - a).collect();
    let mut p = Grid { cells: grid.cells, k, coeffs: r.iter().zip(&diag).map(|(r, d)| r / d).collect() };
    let dot = |a: &[f32], b: &[f32]| -> f64 {
        a.par_chunks(1 << 14)
            .zip(b.par_chunks(1 << 14))
            .map(|(a, b)| a.iter().zip(b).map(|(x, y)| f64::from(x * y)).sum::<f64>())
            .collect::<Vec<_>>()
            .iter()
            .sum()
    };
    let mut rz: f64 = dot(&r, &p.coeffs);
    let first = rz;
    for _ in 0..iterations {
        if rz <= 1e-9 * first || rz <= 0.0 || progress.cancelled() {
            break;
        }
        apply(&p, &mut ax);
        let step = (rz / dot(&p.coeffs, &ax)) as f32;
        grid.coeffs.par_iter_mut().zip(&p.coeffs).for_each(|(x, p)| *x += step * p);
        r.par_iter_mut().zip(&ax).for_each(|(r, a)| *r -= step * a);
        let z: Vec<f32> = r.par_iter().zip(&diag).map(|(r, d)| r / d).collect();
        let next = dot(&r, &z);
        let beta = (next / rz) as f32;
        p.coeffs.par_iter_mut().zip(&z).for_each(|(p, z)| *p = z + beta * *p);
        rz = next;
    }
}

/// Runs `f(sample, spline weight, node)` for every node that a sample touches. Stripes of the same parity touch disjoint
/// rows of nodes, so each parity runs in parallel and the order of additions is fixed.
fn scatter(grid: &Grid, stripes: &[Vec<Sample>], out: &mut [f32], f: impl Fn(&Sample, f32, &mut [f32]) + Sync) {
    let [na, _, nw] = grid.nodes();
    let row = na * nw * grid.k;
    for parity in 0..2 {
        let Some(rest) = out.get_mut(parity * STRIPE * row..) else { continue };
        rest.par_chunks_mut(2 * STRIPE * row).enumerate().for_each(|(i, chunk)| {
            let stripe = 2 * i + parity;
            let Some(samples) = stripes.get(stripe) else { return };
            let offset = stripe * STRIPE * row;
            for s in samples {
                grid.visit(s.q, |base, w| f(s, w, &mut chunk[base - offset..base - offset + grid.k]));
            }
        });
    }
}

/// y += Bᵀ Ω B x, where B evaluates the spline at the samples.
fn normal_product(x: &Grid, stripes: &[Vec<Sample>], bins: &Bins, y: &mut [f32]) {
    match x.k {
        1 => normal_product_k::<1>(x, stripes, bins, y),
        2 => normal_product_k::<2>(x, stripes, bins, y),
        3 => normal_product_k::<3>(x, stripes, bins, y),
        4 => normal_product_k::<4>(x, stripes, bins, y),
        5 => normal_product_k::<5>(x, stripes, bins, y),
        6 => normal_product_k::<6>(x, stripes, bins, y),
        _ => normal_product_any(x, stripes, bins, y),
    }
}

fn normal_product_any(x: &Grid, stripes: &[Vec<Sample>], bins: &Bins, y: &mut [f32]) {
    let k = x.k;
    let row = x.nodes()[0] * x.nodes()[2] * k;
    for parity in 0..2 {
        let Some(rest) = y.get_mut(parity * STRIPE * row..) else { continue };
        rest.par_chunks_mut(2 * STRIPE * row).enumerate().for_each(|(i, chunk)| {
            let stripe = 2 * i + parity;
            let Some(samples) = stripes.get(stripe) else { return };
            let offset = stripe * STRIPE * row;
            let mut v = vec![0.0; k];
            for s in samples {
                x.eval_any(s.q, &mut v);
                for (c, v) in v.iter_mut().enumerate() {
                    *v *= bins.sums[s.at + 2 * c];
                }
                x.visit(s.q, |base, w| {
                    for (c, v) in v.iter().enumerate() {
                        chunk[base - offset + c] += w * v;
                    }
                });
            }
        });
    }
}

fn normal_product_k<const K: usize>(x: &Grid, stripes: &[Vec<Sample>], bins: &Bins, y: &mut [f32]) {
    let [na, _, nw] = x.nodes();
    let row = na * nw * K;
    for parity in 0..2 {
        let Some(rest) = y.get_mut(parity * STRIPE * row..) else { continue };
        rest.par_chunks_mut(2 * STRIPE * row).enumerate().for_each(|(i, chunk)| {
            let stripe = 2 * i + parity;
            let Some(samples) = stripes.get(stripe) else { return };
            let offset = stripe * STRIPE * row;
            for s in samples {
                let mut v = [0.0f32; K];
                x.eval_k::<K>(s.q, &mut v);
                for c in 0..K {
                    v[c] *= bins.sums[s.at + 2 * c];
                }
                let (cell, frac) = x.locate(s.q);
                let [wa, wb, ww] = frac.map(weights);
                for (j, wb) in wb.iter().enumerate() {
                    for (i, wa) in wa.iter().enumerate() {
                        let base = (((cell[1] + j) * na + cell[0] + i) * nw + cell[2]) * K - offset;
                        let node = &mut chunk[base..base + 4 * K];
                        let ab = wa * wb;
                        for (l, ww) in ww.iter().enumerate() {
                            let w = ab * ww;
                            for c in 0..K {
                                node[l * K + c] += w * v[c];
                            }
                        }
                    }
                }
            }
        });
    }
}

/// y += Σ over axes of λ DᵀD x, D the second difference along the axis.
fn penalty(x: &Grid, smooth: Smoothness, lambda: &[f32], y: &mut [f32]) {
    let [na, nb, nw] = x.nodes();
    let k = x.k;
    let row = na * nw * k;
    // (DᵀD x)_i along a chain of n entries `get`.
    let dtd = |i: usize, n: usize, get: &dyn Fn(usize) -> f32| -> f32 {
        let t = |j: isize| -> f32 {
            if j < 1 || j as usize + 1 >= n {
                return 0.0;
            }
            let j = j as usize;
            get(j - 1) - 2.0 * get(j) + get(j + 1)
        };
        let i = i as isize;
        t(i - 1) - 2.0 * t(i) + t(i + 1)
    };
    y.par_chunks_mut(row).enumerate().for_each(|(b, y)| {
        for a in 0..na {
            for w in 0..nw {
                for c in 0..k {
                    let at = |a: usize, b: usize, w: usize| x.coeffs[((b * na + a) * nw + w) * k + c];
                    let across = dtd(a, na, &|i| at(i, b, w)) + dtd(b, nb, &|i| at(a, i, w));
                    let along = dtd(w, nw, &|i| at(a, b, i));
                    y[(a * nw + w) * k + c] += lambda[c] * (smooth.across * across + smooth.along * along);
                }
            }
        }
    });
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

    /// A fit to exact samples of a smooth function reproduces it, and its directional derivative, everywhere.
    #[test]
    fn fits_a_smooth_function() {
        let truth = |q: [f32; 3], c: usize| (7.0 * q[0] + c as f32).sin() * (1.0 + 0.3 * q[2]) + q[1] * q[1];
        for k in [1, 3, 7] {
            let mut bins = Bins::new([80, 60, 12], k);
            let mut rng = 12345u64;
            let mut unit = || {
                rng = rng.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (rng >> 40) as f32 / (1u64 << 24) as f32
            };
            for _ in 0..120_000 {
                let q = [unit(), unit(), unit()];
                let v: Vec<f32> = (0..k).map(|c| truth(q, c)).collect();
                bins.add(q, &v, &vec![1.0; k]);
            }
            let mut grid = Grid::new([40, 30, 4], k);
            fit(&mut grid, &bins, Smoothness { across: 1e-4, along: 1e-4 }, 60, &Progress::none());
            let (mut v, mut d) = (vec![0.0; k], vec![0.0; k]);
            for _ in 0..500 {
                let q = [0.05 + 0.9 * unit(), 0.05 + 0.9 * unit(), 0.05 + 0.9 * unit()];
                grid.eval_along(q, [1.0, 0.0, 0.5], &mut v, &mut d);
                for c in 0..k {
                    let slope = 7.0 * (7.0 * q[0] + c as f32).cos() * (1.0 + 0.3 * q[2])
                        + 0.5 * 0.3 * (7.0 * q[0] + c as f32).sin();
                    assert!((v[c] - truth(q, c)).abs() < 5e-3, "{} {}", v[c], truth(q, c));
                    assert!((d[c] - slope).abs() < 0.2, "{} {slope}", d[c]);
                }
                let mut again = vec![0.0; k];
                grid.eval(q, &mut again);
                assert!(again.iter().zip(&v).all(|(a, b)| (a - b).abs() < 1e-5));
            }
        }
    }
}
