//! The linear system of the surface: data terms on the diagonal, a thin plate that can break between pixels.
//!
//! Minimizes Σ_i h_i (x_i − y_i)² + Σ w_d (D x)_d² over the second differences D along x, along y and mixed. The unknown is
//! inverse depth, in which planes are linear over the image: planes cost nothing, however slanted.

use rayon::prelude::*;

/// A rectangular window of pixels; those with `active = false` take no part.
pub(super) struct Plate {
    /// Width of the window.
    pub(super) width: usize,
    /// Height of the window.
    pub(super) height: usize,
    /// Which pixels are part of the surface.
    pub(super) active: Vec<bool>,
    /// Weight of the second difference along x centered on a pixel (0 where a neighbor is missing).
    pub(super) wxx: Vec<f32>,
    /// Along y.
    pub(super) wyy: Vec<f32>,
    /// Of the mixed difference over the 2 × 2 cell whose top-left pixel this is (counted twice, as in the thin plate).
    pub(super) wxy: Vec<f32>,
}

impl Plate {
    /// A plate without weights.
    pub(super) fn new(width: usize, height: usize, active: Vec<bool>) -> Self {
        let n = width * height;
        assert_eq!(active.len(), n);
        Self { width, height, active, wxx: vec![0.0; n], wyy: vec![0.0; n], wxy: vec![0.0; n] }
    }

    /// The three second differences of `x` at pixel `i = (px, py)`; 0 where a neighbor is missing.
    #[inline]
    pub(super) fn differences(&self, x: &[f32], px: usize, py: usize) -> [f32; 3] {
        let (w, h) = (self.width, self.height);
        let i = py * w + px;
        let mut d = [0.0; 3];
        if !self.active[i] {
            return d;
        }
        if px > 0 && px + 1 < w && self.active[i - 1] && self.active[i + 1] {
            d[0] = x[i - 1] - 2.0 * x[i] + x[i + 1];
        }
        if py > 0 && py + 1 < h && self.active[i - w] && self.active[i + w] {
            d[1] = x[i - w] - 2.0 * x[i] + x[i + w];
        }
        if px + 1 < w && py + 1 < h && self.active[i + 1] && self.active[i + w] && self.active[i + w + 1] {
            d[2] = x[i] - x[i + 1] - x[i + w] + x[i + w + 1];
        }
        d
    }

    /// Sets the weights of all differences from their values in `x`. A surface is smooth to a degree that varies from place
    /// to place: the weight is one over `floor²` plus the local mean of squared differences (over a square of the given
    /// radius, each direction for itself). Differences beyond `crease` are creases or jumps: they do not count as
    /// roughness of their surroundings, and the plate breaks there.
    pub(super) fn reweight(&mut self, x: &[f32], floor: f32, crease: f32, radius: usize) {
        let (w, h) = (self.width, self.height);
        let differences: Vec<[f32; 3]> =
            (0..w * h).into_par_iter().map(|i| self.differences(x, i % w, i / w)).collect();
        for direction in 0..3 {
            let mut sum = vec![0.0f32; w * h];
            let mut count = vec![0.0f32; w * h];
            for i in 0..w * h {
                let d = differences[i][direction];
                if self.there(i % w, i / w)[direction] && d.abs() < crease {
                    sum[i] = d * d;
                    count[i] = 1.0;
                }
            }
            super::box_mean(&mut sum, w, h, radius);
            super::box_mean(&mut count, w, h, radius);
            let out = match direction {
                0 => &mut self.wxx,
                1 => &mut self.wyy,
                _ => &mut self.wxy,
            };
            for i in 0..w * h {
                let mean = if count[i] > 0.0 { sum[i] / count[i] } else { 0.0 };
                let d = differences[i][direction];
                let broken = 1.0 + d * d / (crease * crease);
                out[i] = 1.0 / ((floor * floor + mean) * broken * broken);
            }
        }
        for i in 0..w * h {
            let there = self.there(i % w, i / w);
            self.wxx[i] *= there[0] as u8 as f32;
            self.wyy[i] *= there[1] as u8 as f32;
            // The mixed difference counts twice, as in the thin plate.
            self.wxy[i] *= 2.0 * there[2] as u8 as f32;
        }
    }

    fn there(&self, px: usize, py: usize) -> [bool; 3] {
        let (w, h) = (self.width, self.height);
        let i = py * w + px;
        let a = |c: bool, j: usize| c && self.active[j];
        if !self.active[i] {
            return [false; 3];
        }
        [
            px > 0 && px + 1 < w && a(true, i - 1) && a(true, i + 1),
            py > 0 && py + 1 < h && a(true, i - w) && a(true, i + w),
            px + 1 < w && py + 1 < h && a(true, i + 1) && a(true, i + w) && a(true, i + w + 1),
        ]
    }

    /// y = (diag(h) + DᵀWD) x.
    fn apply(&self, h: &[f32], x: &[f32], scratch: &mut [[f32; 3]], y: &mut [f32]) {
        let (w, rows) = (self.width, self.height);
        scratch.par_chunks_mut(w).enumerate().for_each(|(py, out)| {
            for (px, s) in out.iter_mut().enumerate() {
                let i = py * w + px;
                let mut d = [0.0; 3];
                if self.wxx[i] > 0.0 {
                    d[0] = self.wxx[i] * (x[i - 1] - 2.0 * x[i] + x[i + 1]);
                }
                if self.wyy[i] > 0.0 {
                    d[1] = self.wyy[i] * (x[i - w] - 2.0 * x[i] + x[i + w]);
                }
                if self.wxy[i] > 0.0 {
                    d[2] = self.wxy[i] * (x[i] - x[i + 1] - x[i + w] + x[i + w + 1]);
                }
                *s = d;
            }
        });
        let s = &*scratch;
        y.par_chunks_mut(w).enumerate().for_each(|(py, out)| {
            for (px, y) in out.iter_mut().enumerate() {
                let i = py * w + px;
                if !self.active[i] {
                    *y = 0.0;
                    continue;
                }
                let mut v = h[i] * x[i] - 2.0 * (s[i][0] + s[i][1]) + s[i][2];
                if px > 0 {
                    v += s[i - 1][0] - s[i - 1][2];
                }
                if px + 1 < w {
                    v += s[i + 1][0];
                }
                if py > 0 {
                    v += s[i - w][1] - s[i - w][2];
                    if px > 0 {
                        v += s[i - w - 1][2];
                    }
                }
                if py + 1 < rows {
                    v += s[i + w][1];
                }
                *y = v;
            }
        });
    }

    /// Dᵀ√W ε for random ε: with √h ε it makes a right-hand side whose solution is a draw from the posterior.
    pub(super) fn noise(&self, mut normal: impl FnMut() -> f32) -> Vec<f32> {
        let w = self.width;
        let mut out = vec![0.0; self.active.len()];
        for i in 0..out.len() {
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

    /// Solves (diag(h) + DᵀWD) x = b by conjugate gradients from the given start, with a diagonal preconditioner.
    /// Stops when the residual has fallen by 1e-4 or after so many iterations; returns how many it took.
    pub(super) fn solve(&self, h: &[f32], b: &[f32], x: &mut [f32], iterations: usize) -> usize {
        let w = self.width;
        let n = x.len();
        let inverse = self.inverse_diagonal(h);
        let dot = |a: &[f32], b: &[f32]| -> f64 {
            a.par_chunks(w)
                .zip(b.par_chunks(w))
                .map(|(a, b)| a.iter().zip(b).map(|(x, y)| f64::from(*x) * f64::from(*y)).sum::<f64>())
                .collect::<Vec<_>>()
                .iter()
                .sum()
        };
        let mut scratch = vec![[0.0; 3]; n];
        let mut ap = vec![0.0; n];
        self.apply(h, x, &mut scratch, &mut ap);
        let mut r: Vec<f32> =
            b.iter().zip(&ap).zip(&self.active).map(|((b, a), on)| if *on { b - a } else { 0.0 }).collect();
        let mut z: Vec<f32> = r.iter().zip(&inverse).map(|(r, d)| r * d).collect();
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        let first = rz;
        for iteration in 0..iterations {
            if rz <= 1e-8 * first || rz <= 0.0 {
                return iteration;
            }
            self.apply(h, &p, &mut scratch, &mut ap);
            let pap = dot(&p, &ap);
            if pap <= 0.0 {
                return iteration;
            }
            let step = (rz / pap) as f32;
            for i in 0..n {
                x[i] += step * p[i];
                r[i] -= step * ap[i];
                z[i] = r[i] * inverse[i];
            }
            let next = dot(&r, &z);
            let beta = (next / rz) as f32;
            for i in 0..n {
                p[i] = z[i] + beta * p[i];
            }
            rz = next;
        }
        iterations
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plate() -> (Plate, Vec<f32>) {
        let (w, h) = (40, 30);
        let active = (0..w * h).map(|i| !((i % w) > 15 && (i % w) < 18 && (i / w) > 10)).collect();
        let x = (0..w * h).map(|i| 3.0 + 0.2 * (i % w) as f32 - 0.1 * (i / w) as f32).collect();
        (Plate::new(w, h, active), x)
    }

    /// DᵀWD x.
    fn roughness(p: &Plate, x: &[f32]) -> Vec<f32> {
        let mut y = vec![0.0; x.len()];
        p.apply(&vec![0.0; x.len()], x, &mut vec![[0.0; 3]; x.len()], &mut y);
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
        let n = p.solve(&h, &b, &mut y, 3000);
        assert!(n < 3000, "{n} iterations");
        for i in 0..x.len() {
            if p.active[i] {
                assert!((y[i] - x[i]).abs() < 0.02, "{i}: {} {}", y[i], x[i]);
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
        let (a, b) = (dot(&roughness(&p, &u), &v), dot(&u, &roughness(&p, &v)));
        assert!((a - b).abs() < 1e-3 * a.abs().max(1.0), "{a} {b}");
    }
}
