//! The linear system of the surface: data terms on the diagonal, a thin plate that can break between pixels.
//!
//! Minimizes Σ_i h_i (x_i − y_i)² + Σ w_d (D x)_d² over the second differences D along x, along y and mixed. The unknown is
//! inverse depth, in which planes are linear over the image: planes cost nothing, however slanted.

use rayon::prelude::*;

use nelu3d_scan::image::box_mean;

/// A rectangular window of pixels; those with `active = false` take no part. The outermost ring of pixels never does, so
/// that no stencil leaves the window.
pub(super) struct ThinPlatePrior {
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
pub(super) struct StopCriterion {
    /// The residual (in the preconditioner's norm) has fallen by this factor.
    pub(super) reduction: f64,
    /// So many iterations.
    pub(super) iterations: usize,
}

impl ThinPlatePrior {
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
    fn difference(&self, x: &[f32], i: usize, direction: usize) -> f32 {
        let w = self.width;
        let x = |i: usize| x[i];
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
    pub(super) fn reweight(&mut self, x: &[f32], floor: f32, crease: f32, radius: usize) {
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

    /// y = (diag(h) + DᵀWD) x for the rows of one block; returns Σ x y.
    fn apply_block(&self, block: usize, h: &[f32], x: &[f32], scratch: &mut Scratch, y: &mut [f32]) -> f64 {
        let w = self.width;
        let first = block * BLOCK;
        let rows = y.len() / w;
        // Inner pixels of a row: all slices below have this length, so that loops over them need no checks.
        let n = w - 2;
        // Scratch row r is image row first + r − 1.
        for r in 0..rows + 2 {
            let [xx, yy, xy] = scratch.each_mut().map(|s| &mut s[r * w..(r + 1) * w]);
            let Some(row) = (first + r).checked_sub(1).filter(|row| *row > 0 && row + 1 < self.height) else {
                [xx, yy, xy].into_iter().for_each(|s| s.fill(0.0));
                continue;
            };
            let at = row * w;
            let (west, here, east) = (&x[at..][..n], &x[at + 1..][..n], &x[at + 2..][..n]);
            let (north, south, south_east) = (&x[at + 1 - w..][..n], &x[at + 1 + w..][..n], &x[at + 2 + w..][..n]);
            let (wxx, wyy, wxy) = (&self.wxx[at + 1..][..n], &self.wyy[at + 1..][..n], &self.wxy[at + 1..][..n]);
            let (xx, yy, xy) = (&mut xx[1..][..n], &mut yy[1..][..n], &mut xy[1..][..n]);
            for i in 0..n {
                let c = here[i];
                xx[i] = wxx[i] * (west[i] - 2.0 * c + east[i]);
                yy[i] = wyy[i] * (north[i] - 2.0 * c + south[i]);
                xy[i] = wxy[i] * (c - east[i] - south[i] + south_east[i]);
            }
        }
        let [xx, yy, xy] = &*scratch;
        let mut dot = 0.0;
        for (r, y) in y.chunks_exact_mut(w).enumerate() {
            let at = (first + r) * w + 1;
            let (h, x) = (&h[at..][..n], &x[at..][..n]);
            // Of the row above, of this and of the one below in scratch.
            let [above, here, below] = [r, r + 1, r + 2].map(|r| r * w + 1);
            let (west, middle, east) = (&xx[here - 1..][..n], &xx[here..][..n], &xx[here + 1..][..n]);
            let (north, center, south) = (&yy[above..][..n], &yy[here..][..n], &yy[below..][..n]);
            let (own, left) = (&xy[here..][..n], &xy[here - 1..][..n]);
            let (up, up_left) = (&xy[above..][..n], &xy[above - 1..][..n]);
            let y = &mut y[1..][..n];
            for i in 0..n {
                let straight = west[i] - 2.0 * middle[i] + east[i] + north[i] - 2.0 * center[i] + south[i];
                let mixed = own[i] - left[i] - up[i] + up_left[i];
                y[i] = h[i] * x[i] + straight + mixed;
            }
            dot += dot_row(x, y);
        }
        dot
    }

    /// Σ w (D x)² of the differences at each pixel.
    pub(super) fn energy(&self, x: &[f32]) -> Vec<f32> {
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

    /// The mean weight of a pixel's own second differences along x and y, logarithmic: what a uniform plate would have around it. 0 where there is none.
    pub(super) fn weight(&self, i: usize) -> f32 {
        match (self.wxx[i], self.wyy[i]) {
            (a, b) if a > 0.0 && b > 0.0 => (a * b).sqrt(),
            (a, b) => a.max(b),
        }
    }

    /// Dᵀ√W ε for random ε: with √h ε it makes a right-hand side whose solution is a draw from the posterior.
    #[cfg(test)]
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

    /// Solves (diag(h) + DᵀWD) x = b by conjugate gradients from the given start, with a diagonal preconditioner. Returns how many
    /// iterations it took. The start must be 0 where there is no surface.
    pub(super) fn solve(&self, h: &[f32], b: &[f32], x: &mut [f32], until: StopCriterion) -> usize {
        let (w, n) = (self.width, x.len());
        let rows = BLOCK * w;
        let inverse = self.inverse_diagonal(h);
        let mut scratch: Vec<Scratch> =
            (0..self.height.div_ceil(BLOCK)).map(|_| [(); 3].map(|()| vec![0.0; (BLOCK + 2) * w])).collect();
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
        let first: f64 = r.chunks(w).zip(p.chunks(w)).map(|(r, p)| dot_row(r, p)).sum();
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

/// Weighed differences of a block's rows and of the row above and below: along x, along y, mixed.
type Scratch = [Vec<f32>; 3];

/// Partial sums that are taken side by side, which is what vector units do.
const SUMS: usize = 16;

/// Σ a b of a row.
fn dot_row(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0f32; SUMS];
    let (a, b) = (a.chunks_exact(SUMS), b.chunks_exact(SUMS));
    let rest: f32 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for l in 0..SUMS {
            sums[l] += a[l] * b[l];
        }
    }
    f64::from(rest + sums.iter().sum::<f32>())
}

/// Σ w a² of a row.
fn weighted_square(a: &[f32], weight: &[f32]) -> f64 {
    let mut sums = [0.0f32; SUMS];
    let (a, weight) = (a.chunks_exact(SUMS), weight.chunks_exact(SUMS));
    let rest: f32 = a.remainder().iter().zip(weight.remainder()).map(|(a, w)| w * a * a).sum();
    for (a, w) in a.zip(weight) {
        for l in 0..SUMS {
            sums[l] += w[l] * a[l] * a[l];
        }
    }
    f64::from(rest + sums.iter().sum::<f32>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plate() -> (ThinPlatePrior, Vec<f32>) {
        let (w, h) = (40, 30);
        let ring = |x: usize, y: usize| x == 0 || x == w - 1 || y == 0 || y == h - 1;
        let hole = |x: usize, y: usize| x > 15 && x < 18 && y > 10;
        let active: Vec<bool> = (0..w * h).map(|i| !ring(i % w, i / w) && !hole(i % w, i / w)).collect();
        let plane = |i: usize| 3.0 + 0.2 * (i % w) as f32 - 0.1 * (i / w) as f32;
        let x = (0..w * h).map(|i| if active[i] { plane(i) } else { 0.0 }).collect();
        (ThinPlatePrior::new(w, h, active), x)
    }

    /// DᵀWD x.
    fn roughness(p: &ThinPlatePrior, x: &[f32]) -> Vec<f32> {
        let mut y = vec![0.0; x.len()];
        let h = vec![0.0; x.len()];
        let mut scratch = [(); 3].map(|()| vec![0.0; (BLOCK + 2) * p.width]);
        for (block, y) in y.chunks_mut(BLOCK * p.width).enumerate() {
            p.apply_block(block, &h, x, &mut scratch, y);
        }
        y
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
        let b: Vec<f32> = h.iter().zip(&x).map(|(h, x)| h * x).collect();
        let mut y = vec![0.0; x.len()];
        let n = p.solve(&h, &b, &mut y, StopCriterion { reduction: 1e-4, iterations: 3000 });
        assert!(n < 3000, "{n} iterations");
        for i in 0..x.len() {
            if p.active[i] {
                assert!((y[i] - x[i]).abs() < 0.02, "{i}: {} {}", y[i], x[i]);
            } else {
                assert_eq!(y[i], 0.0);
            }
        }
    }

    /// The operator is symmetric: ⟨Ax, y⟩ = ⟨x, Ay⟩, with holes and uneven weights.
    #[test]
    fn the_operator_is_symmetric() {
        let (mut p, x) = plate();
        p.reweight(&x.iter().map(|v| (v * 7.3).sin()).collect::<Vec<_>>(), 0.3, 1.0, 2);
        let on = |f: &dyn Fn(usize) -> f32| -> Vec<f32> {
            (0..x.len()).map(|i| if p.active[i] { f(i) } else { 0.0 }).collect()
        };
        let (u, v) = (on(&|i| (i as f32 * 0.7).sin()), on(&|i| (i as f32 * 1.3).cos()));
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
        let (a, b) = (dot(&v, &roughness(&p, &u)), dot(&u, &roughness(&p, &v)));
        assert!((a - b).abs() < 1e-3 * a.abs().max(1.0), "{a} {b}");
    }
}
