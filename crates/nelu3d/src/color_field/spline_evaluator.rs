//! The color field's spline, evaluated fast: what every inner loop of the reconstruction calls.

use nelu3d_field::cost_volume::Lattice;

use super::grid::Grid;

/// A spline, evaluated. Gives what [`Grid::eval`] and [`Grid::eval_along`] give, faster: the four nodes along w of all channels
/// lie side by side in memory and are summed as one vector over (a, b) before w is looked at.
pub struct SplineEvaluator<'a> {
    grid: &'a Grid,
    stride: [usize; 2],
    /// Cells per pixel.
    cells_per_pixel: f32,
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

impl<'a> SplineEvaluator<'a> {
    /// For the given spline of a field with `cells_per_pixel` cells per pixel across.
    pub fn new(grid: &'a Grid, cells_per_pixel: usize) -> Self {
        let [na, _, nw] = grid.nodes();
        Self { grid, stride: [nw * grid.k, na * nw * grid.k], cells_per_pixel: cells_per_pixel as f32 }
    }

    /// Channels.
    pub fn k(&self) -> usize {
        self.grid.k
    }

    /// The spline itself.
    pub(crate) fn lattice(&self) -> Lattice<'a> {
        Lattice { cells: self.grid.cells, k: self.grid.k, nodes: &self.grid.coeffs }
    }

    /// Pixels across the field along a and b: what disparities are measured in, however fine its cells are.
    pub fn pixels(&self) -> [f32; 2] {
        [0, 1].map(|i| self.grid.cells[i] as f32 / self.cells_per_pixel)
    }

    /// Offset of the first of the 4 × 4 × 4 nodes, and the position in the cell.
    #[inline(always)]
    fn locate(&self, q: [f32; 3]) -> (usize, [f32; 3]) {
        let mut cell = [0; 3];
        let mut frac = [0.0; 3];
        for i in 0..3 {
            let n = self.grid.cells[i];
            let u = (q[i] * n as f32).clamp(0.0, n as f32);
            cell[i] = (u as usize).min(n - 1);
            frac[i] = u - cell[i] as f32;
        }
        (cell[1] * self.stride[1] + cell[0] * self.stride[0] + cell[2] * self.grid.k, frac)
    }

    /// c at unit coordinates `q` (clamped to the cube), into `out` (k values).
    #[inline]
    pub fn eval(&self, q: [f32; 3], out: &mut [f32]) {
        match self.grid.k {
            1 => self.eval_n::<4>(q, out),
            2 => self.eval_n::<8>(q, out),
            3 => self.eval_n::<12>(q, out),
            4 => self.eval_n::<16>(q, out),
            5 => self.eval_n::<20>(q, out),
            6 => self.eval_n::<24>(q, out),
            _ => self.grid.eval(q, out),
        }
    }

    /// c and its derivative in the direction `dq`, into `out` and `dout` (k values each).
    #[inline]
    pub fn eval_along(&self, q: [f32; 3], dq: [f32; 3], out: &mut [f32], dout: &mut [f32]) {
        match self.grid.k {
            1 => self.eval_along_n::<4>(q, dq, out, dout),
            2 => self.eval_along_n::<8>(q, dq, out, dout),
            3 => self.eval_along_n::<12>(q, dq, out, dout),
            4 => self.eval_along_n::<16>(q, dq, out, dout),
            5 => self.eval_along_n::<20>(q, dq, out, dout),
            6 => self.eval_along_n::<24>(q, dq, out, dout),
            _ => self.grid.eval_along(q, dq, out, dout),
        }
    }

    /// For N = 4 k.
    #[inline(always)]
    fn eval_n<const N: usize>(&self, q: [f32; 3], out: &mut [f32]) {
        let (base, frac) = self.locate(q);
        let [wa, wb, ww] = frac.map(weights);
        let mut sum = [0.0f32; N];
        for j in 0..4 {
            for i in 0..4 {
                let at = base + j * self.stride[1] + i * self.stride[0];
                let nodes: &[f32; N] = self.grid.coeffs[at..at + N].try_into().expect("N nodes");
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

    /// For N = 4 k.
    #[inline(always)]
    fn eval_along_n<const N: usize>(&self, q: [f32; 3], dq: [f32; 3], out: &mut [f32], dout: &mut [f32]) {
        let (base, frac) = self.locate(q);
        let [wa, wb, ww] = frac.map(weights);
        let mut d = frac.map(slopes);
        for i in 0..3 {
            let scale = dq[i] * self.grid.cells[i] as f32;
            d[i].iter_mut().for_each(|s| *s *= scale);
        }
        let (mut sum, mut dsum) = ([0.0f32; N], [0.0f32; N]);
        for j in 0..4 {
            for i in 0..4 {
                let at = base + j * self.stride[1] + i * self.stride[0];
                let nodes: &[f32; N] = self.grid.coeffs[at..at + N].try_into().expect("N nodes");
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_spline_itself() {
        for k in 1..9 {
            let mut grid = Grid::new([7, 5, 4], k);
            for (i, c) in grid.coeffs.iter_mut().enumerate() {
                *c = ((i * 7919 % 1009) as f32 / 1009.0 - 0.5) * 2.0;
            }
            let lookup = SplineEvaluator::new(&grid, 1);
            let (mut a, mut b) = (vec![0.0; k], vec![0.0; k]);
            let (mut da, mut db) = (vec![0.0; k], vec![0.0; k]);
            for s in 0..50 {
                let q = [0.3 + 0.7 * (s as f32 * 0.37).sin(), (s as f32 * 0.11) % 1.0, 1.02 - s as f32 * 0.02];
                let dq = [0.2, -0.5, 0.1 * s as f32];
                grid.eval_along(q, dq, &mut a, &mut da);
                lookup.eval_along(q, dq, &mut b, &mut db);
                let scale = da.iter().fold(1.0f32, |m, d| m.max(d.abs()));
                for c in 0..k {
                    assert!((a[c] - b[c]).abs() < 1e-5 && (da[c] - db[c]).abs() < 1e-5 * scale, "{k} {s}");
                }
                lookup.eval(q, &mut b);
                assert!((0..k).all(|c| (a[c] - b[c]).abs() < 1e-5), "{k} {s}");
            }
        }
    }
}
