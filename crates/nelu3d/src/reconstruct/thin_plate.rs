//! The linear system of the surface: data terms on the diagonal, a thin plate that can break between pixels.
//!
//! Minimizes Σ_i h_i (x_i − y_i)² + Σ w_d (D x)_d² over the second differences D along x, along y and mixed. The unknown is
//! inverse depth, in which planes are linear over the image: planes cost nothing, however slanted.

use rayon::prelude::*;

use super::smooth::box_mean;

/// A rectangular window of pixels; those with `active = false` take no part. The outermost ring of pixels never does, so
/// that no stencil leaves the window.
pub(super) struct Plate {
    /// Width of the window.
    pub(super) width: usize,
    /// Height of the window.
    pub(super) height: usize,
    /// Which pixels are part of the surface.
    pub(super) active: Vec<bool>,
    /// Weight of the second difference along x centered on a pixel (0 where a neighbor is missing).
    wxx: Vec<f32>,
    /// Along y.
    wyy: Vec<f32>,
    /// Of the mixed difference over the 2 × 2 cell whose top-left pixel this is (counted twice, as in the thin plate).
    wxy: Vec<f32>,
}

/// Rows that one task of the solver works on. Sums are taken block by block, in order: they do not depend on the threads.
const BLOCK: usize = 16;

/// When the solver stops.
#[derive(Clone, Copy, Debug)]
pub(super) struct Until {
    /// The residual (in the preconditioner's norm) has fallen by this factor.
    pub(super) reduction: f64,
    /// So many iterations.
    pub(super) iterations: usize,
}

impl Plate {
    /// A plate without weights.
    pub(super) fn new(width: usize, height: usize, active: Vec<bool>) -> Self {
        let n = width * height;
        assert_eq!(active.len(), n);
        let ring = |i: usize| [0, width - 1].contains(&(i % width)) || [0, height - 1].contains(&(i / width));
        assert!((0..n).all(|i| !(active[i] && ring(i))), "the outermost ring of a plate must be free");
        Self { width, height, active, wxx: vec![0.0; n], wyy: vec![0.0; n], wxy: vec![0.0; n] }
    }

    /// Which of the three second differences exist at pixel `i`.
    #[inline]
    fn there(&self, i: usize) -> [bool; 3] {
        let (a, w) = (&self.active, self.width);
        if !a[i] {
            return [false; 3];
        }
        [a[i - 1] && a[i + 1], a[i - w] && a[i + w], a[i + 1] && a[i + w] && a[i + w + 1]]
    }

    /// A second difference of `x` at pixel `i`, where it exists: along x, along y, mixed.
    #[inline]
    fn difference(&self, x: &[[f32; 1]], i: usize, direction: usize) -> f32 {
        let w = self.width;
        let x = |i: usize| x[i][0];
        match direction {
            0 => x(i - 1) - 2.0 * x(i) + x(i + 1),
            1 => x(i - w) - 2.0 * x(i) + x(i + w),
            _ => x(i) - x(i + 1) - x(i + w) + x(i + w + 1),
        }
    }

    /// Sets the weights of all differences from their values in `x`. A surface is smooth to a degree that varies from place
    /// to place: the weight is one over `floor²` plus the local mean of squared differences (over a square of the given
    /// radius, each direction for itself). Differences beyond `crease` are creases or jumps: they do not count as
    /// roughness of their surroundings, and the plate breaks there.
    pub(super) fn reweight(&mut self, x: &[[f32; 1]], floor: f32, crease: f32, radius: usize) {
        let (w, h) = (self.width, self.height);
        let this = &*self;
        let weights: Vec<Vec<f32>> = (0..3)
            .into_par_iter()
            .map(|direction| {
                let there = |i: usize| this.there(i)[direction];
                let (mut sum, mut count) = (vec![0.0f32; w * h], vec![0.0f32; w * h]);
                for i in (0..w * h).filter(|i| there(*i)) {
                    let d = this.difference(x, i, direction);
                    if d.abs() < crease {
                        sum[i] = d * d;
                        count[i] = 1.0;
                    }
                }
                box_mean(&mut sum, w, h, radius);
                box_mean(&mut count, w, h, radius);
                // The mixed difference counts twice, as in the thin plate.
                let times = if direction == 2 { 2.0 } else { 1.0 };
                for i in 0..w * h {
                    sum[i] = if there(i) {
                        let mean = if count[i] > 0.0 { sum[i] / count[i] } else { 0.0 };
                        let d = this.difference(x, i, direction);
                        let broken = 1.0 + d * d / (crease * crease);
                        times / ((floor * floor + mean) * broken * broken)
                    } else {
                        0.0
                    };
                }
                sum
            })
            .collect();
        [self.wxx, self.wyy, self.wxy] = weights.try_into().expect("three directions");
    }

    /// y = (diag(h) + DᵀWD) x for the rows of one block, for L right-hand sides at once; returns Σ x y. `scratch` holds the
    /// weighed differences of the block's rows and of the row above and below.
    fn apply_block<const L: usize>(
        &self,
        block: usize,
        h: &[f32],
        x: &[[f32; L]],
        scratch: &mut [[[f32; L]; 3]],
        y: &mut [[f32; L]],
    ) -> [f64; L] {
        let w = self.width;
        let first = block * BLOCK;
        let rows = y.len() / w;
        // Scratch row r is image row first + r − 1.
        for r in 0..rows + 2 {
            let Some(row) = (first + r).checked_sub(1).filter(|row| *row > 0 && row + 1 < self.height) else {
                scratch[r * w..(r + 1) * w].fill([[0.0; L]; 3]);
                continue;
            };
            let at = row * w;
            let (above, here, below) = (&x[at - w..at], &x[at..at + w], &x[at + w..at + 2 * w]);
            let (wxx, wyy, wxy) = (&self.wxx[at..at + w], &self.wyy[at..at + w], &self.wxy[at..at + w]);
            let out = &mut scratch[r * w..(r + 1) * w];
            for i in 1..w - 1 {
                for l in 0..L {
                    let (c, e, s) = (here[i][l], here[i + 1][l], below[i][l]);
                    out[i][0][l] = wxx[i] * (here[i - 1][l] - 2.0 * c + e);
                    out[i][1][l] = wyy[i] * (above[i][l] - 2.0 * c + s);
                    out[i][2][l] = wxy[i] * (c - e - s + below[i + 1][l]);
                }
            }
        }
        let mut dot = [0.0f64; L];
        for (r, y) in y.chunks_exact_mut(w).enumerate() {
            let at = (first + r) * w;
            let (h, x) = (&h[at..at + w], &x[at..at + w]);
            let (above, here, below) =
                (&scratch[r * w..(r + 1) * w], &scratch[(r + 1) * w..(r + 2) * w], &scratch[(r + 2) * w..(r + 3) * w]);
            for i in 1..w - 1 {
                for l in 0..L {
                    let straight = here[i - 1][0][l] - 2.0 * here[i][0][l] + here[i + 1][0][l] + above[i][1][l]
                        - 2.0 * here[i][1][l]
                        + below[i][1][l];
                    let mixed = here[i][2][l] - here[i - 1][2][l] - above[i][2][l] + above[i - 1][2][l];
                    y[i][l] = h[i] * x[i][l] + straight + mixed;
                }
            }
            let mut sum = [0.0f32; L];
            for i in 1..w - 1 {
                for l in 0..L {
                    sum[l] += x[i][l] * y[i][l];
                }
            }
            for l in 0..L {
                dot[l] += f64::from(sum[l]);
            }
        }
        dot
    }

    /// Σ w (D x)² of the differences at each pixel.
    pub(super) fn energy(&self, x: &[[f32; 1]]) -> Vec<f32> {
        let one = |i: usize| {
            let weights = [self.wxx[i], self.wyy[i], self.wxy[i]];
            if weights == [0.0; 3] {
                return 0.0;
            }
            let there = self.there(i);
            let d = |j: usize| if there[j] { self.difference(x, i, j) } else { 0.0 };
            (0..3).map(|j| weights[j] * d(j).powi(2)).sum()
        };
        (0..x.len()).into_par_iter().with_min_len(self.width).map(one).collect()
    }

    /// Dᵀ√W ε for random ε: with √h ε it makes a right-hand side whose solution is a draw from the posterior.
    pub(super) fn noise(&self, mut normal: impl FnMut() -> f32) -> Vec<f32> {
        let w = self.width;
        let mut out = vec![0.0; self.active.len()];
        for i in (0..out.len()).filter(|i| self.active[*i]) {
            let (a, b, c) = (self.wxx[i], self.wyy[i], self.wxy[i]);
            if a > 0.0 {
                let e = a.sqrt() * normal();
                out[i - 1] += e;
                out[i] -= 2.0 * e;
                out[i + 1] += e;
            }
            if b > 0.0 {
                let e = b.sqrt() * normal();
                out[i - w] += e;
                out[i] -= 2.0 * e;
                out[i + w] += e;
            }
            if c > 0.0 {
                let e = c.sqrt() * normal();
                out[i] += e;
                out[i + 1] -= e;
                out[i + w] -= e;
                out[i + w + 1] += e;
            }
        }
        out
    }

    /// One over the diagonal of (diag(h) + DᵀWD); 0 where there is no surface.
    fn inverse_diagonal(&self, h: &[f32]) -> Vec<f32> {
        let w = self.width;
        let mut diag = h.to_vec();
        for i in 0..diag.len() {
            let (a, c, e) = (self.wxx[i], self.wyy[i], self.wxy[i]);
            if a > 0.0 {
                diag[i - 1] += a;
                diag[i] += 4.0 * a;
                diag[i + 1] += a;
            }
            if c > 0.0 {
                diag[i - w] += c;
                diag[i] += 4.0 * c;
                diag[i + w] += c;
            }
            if e > 0.0 {
                for j in [i, i + 1, i + w, i + w + 1] {
                    diag[j] += e;
                }
            }
        }
        diag.iter().zip(&self.active).map(|(d, on)| if *on && *d > 0.0 { 1.0 / d } else { 0.0 }).collect()
    }

    /// Solves (diag(h) + DᵀWD) x = b for L right-hand sides at once by conjugate gradients from the given start, with a
    /// diagonal preconditioner. Returns how many iterations it took. The start must be 0 where there is no surface.
    pub(super) fn solve<const L: usize>(&self, h: &[f32], b: &[[f32; L]], x: &mut [[f32; L]], until: Until) -> usize {
        let (w, n) = (self.width, x.len());
        let rows = BLOCK * w;
        let inverse = self.inverse_diagonal(h);
        let mut scratch = vec![vec![[[0.0f32; L]; 3]; (BLOCK + 2) * w]; self.height.div_ceil(BLOCK)];
        let mut ap = vec![[0.0f32; L]; n];
        let apply = |x: &[[f32; L]], y: &mut [[f32; L]], scratch: &mut [Vec<[[f32; L]; 3]>]| -> [f64; L] {
            let sums: Vec<[f64; L]> = y
                .par_chunks_mut(rows)
                .zip(scratch)
                .enumerate()
                .map(|(block, (y, scratch))| self.apply_block(block, h, x, scratch, y))
                .collect();
            total(&sums)
        };
        apply(x, &mut ap, &mut scratch);
        let mut r = vec![[0.0f32; L]; n];
        for i in (0..n).filter(|i| self.active[*i]) {
            for l in 0..L {
                r[i][l] = b[i][l] - ap[i][l];
            }
        }
        let mut p: Vec<[f32; L]> = r.iter().zip(&inverse).map(|(r, d)| r.map(|r| r * d)).collect();
        let first: [f64; L] = {
            let sums: Vec<[f64; L]> =
                r.chunks(rows).zip(p.chunks(rows)).map(|(r, p)| std::array::from_fn(|l| dot_lane(r, p, l))).collect();
            total(&sums)
        };
        let mut rz = first;
        for iteration in 0..until.iterations {
            if (0..L).all(|l| rz[l] <= until.reduction * until.reduction * first[l]) {
                return iteration;
            }
            let pap = apply(&p, &mut ap, &mut scratch);
            let step: [f32; L] = std::array::from_fn(|l| if pap[l] > 0.0 { (rz[l] / pap[l]) as f32 } else { 0.0 });
            let sums: Vec<[f64; L]> = x
                .par_chunks_mut(rows)
                .zip(r.par_chunks_mut(rows))
                .zip(p.par_chunks(rows).zip(ap.par_chunks(rows)))
                .zip(inverse.par_chunks(rows))
                .map(|(((x, r), (p, ap)), inverse)| {
                    let mut sums = [0.0f64; L];
                    for at in (0..x.len()).step_by(w) {
                        let mut sum = [0.0f32; L];
                        for i in at..at + w {
                            for l in 0..L {
                                x[i][l] += step[l] * p[i][l];
                                r[i][l] -= step[l] * ap[i][l];
                                sum[l] += r[i][l] * r[i][l] * inverse[i];
                            }
                        }
                        (0..L).for_each(|l| sums[l] += f64::from(sum[l]));
                    }
                    sums
                })
                .collect();
            let next = total(&sums);
            let beta: [f32; L] = std::array::from_fn(|l| if rz[l] > 0.0 { (next[l] / rz[l]) as f32 } else { 0.0 });
            p.par_chunks_mut(rows).zip(r.par_chunks(rows)).zip(inverse.par_chunks(rows)).for_each(
                |((p, r), inverse)| {
                    for i in 0..p.len() {
                        for l in 0..L {
                            p[i][l] = r[i][l] * inverse[i] + beta[l] * p[i][l];
                        }
                    }
                },
            );
            rz = next;
        }
        until.iterations
    }
}

fn dot_lane<const L: usize>(a: &[[f32; L]], b: &[[f32; L]], l: usize) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a[l]) * f64::from(b[l])).sum()
}

fn total<const L: usize>(sums: &[[f64; L]]) -> [f64; L] {
    std::array::from_fn(|l| sums.iter().map(|s| s[l]).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plate() -> (Plate, Vec<[f32; 1]>) {
        let (w, h) = (40, 30);
        let ring = |x: usize, y: usize| x == 0 || x == w - 1 || y == 0 || y == h - 1;
        let hole = |x: usize, y: usize| x > 15 && x < 18 && y > 10;
        let active: Vec<bool> = (0..w * h).map(|i| !ring(i % w, i / w) && !hole(i % w, i / w)).collect();
        let plane = |i: usize| 3.0 + 0.2 * (i % w) as f32 - 0.1 * (i / w) as f32;
        let x = (0..w * h).map(|i| [if active[i] { plane(i) } else { 0.0 }]).collect();
        (Plate::new(w, h, active), x)
    }

    /// DᵀWD x.
    fn roughness(p: &Plate, x: &[[f32; 1]]) -> Vec<f32> {
        let mut y = vec![[0.0]; x.len()];
        let h = vec![0.0; x.len()];
        let mut scratch = vec![[[0.0; 1]; 3]; (BLOCK + 2) * p.width];
        for (block, y) in y.chunks_mut(BLOCK * p.width).enumerate() {
            p.apply_block(block, &h, x, &mut scratch, y);
        }
        y.iter().map(|y| y[0]).collect()
    }

    #[test]
    fn planes_cost_nothing() {
        let (mut p, x) = plate();
        p.reweight(&x, 0.5, 10.0, 2);
        assert!(roughness(&p, &x).iter().all(|v| v.abs() < 1e-3));
    }

    /// The solution of sparse noise-free data on a plane is the plane.
    #[test]
    fn a_plane_is_recovered_from_few_points() {
        let (mut p, x) = plate();
        p.reweight(&x, 1.0, 10.0, 2);
        let h: Vec<f32> = (0..x.len()).map(|i| if i % 7 == 0 && p.active[i] { 1.0 } else { 0.0 }).collect();
        // Two planes at once: the second is three times as steep.
        let b: Vec<[f32; 2]> = h.iter().zip(&x).map(|(h, x)| [h * x[0], 3.0 * h * x[0]]).collect();
        let mut y = vec![[0.0; 2]; x.len()];
        let n = p.solve(&h, &b, &mut y, Until { reduction: 1e-4, iterations: 3000 });
        assert!(n < 3000, "{n} iterations");
        for i in 0..x.len() {
            let (y, [x]) = (y[i], x[i]);
            if p.active[i] {
                assert!((y[0] - x).abs() < 0.02 && (y[1] - 3.0 * x).abs() < 0.06, "{i}: {y:?} {x}");
            } else {
                assert_eq!(y, [0.0; 2]);
            }
        }
    }

    /// The operator is symmetric: ⟨Ax, y⟩ = ⟨x, Ay⟩, with holes and uneven weights.
    #[test]
    fn the_operator_is_symmetric() {
        let (mut p, x) = plate();
        p.reweight(&x.iter().map(|v| [(v[0] * 7.3).sin()]).collect::<Vec<_>>(), 0.3, 1.0, 2);
        let on = |f: &dyn Fn(usize) -> f32| -> Vec<[f32; 1]> {
            (0..x.len()).map(|i| [if p.active[i] { f(i) } else { 0.0 }]).collect()
        };
        let (u, v) = (on(&|i| (i as f32 * 0.7).sin()), on(&|i| (i as f32 * 1.3).cos()));
        let dot = |b: &[[f32; 1]], a: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b[0])).sum::<f64>();
        let (a, b) = (dot(&v, &roughness(&p, &u)), dot(&u, &roughness(&p, &v)));
        assert!((a - b).abs() < 1e-3 * a.abs().max(1.0), "{a} {b}");
    }
}
