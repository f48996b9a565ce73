//! The plain form, generic over `f32` and `f64`.

use super::hypotheses::HypothesisLine;
use super::problem::{DIRECTIONS, NEAR, OUTSIDE, Problem, Winner};
use crate::lattice::{Lattice, weights};
use crate::real::Real;

/// Returns the cell of a coordinate in `[0, 1]`, and the position in it.
fn locate<T: Real>(q: T, cells: usize) -> (usize, T) {
    let u = q * T::of(cells as f64);
    let cell = (u.to_f64() as usize).min(cells - 1);
    (cell, u - T::of(cell as f64))
}

/// Returns the point of hypothesis `index`, which may lie between two, in the unit cube; `None` outside of it.
pub fn point<T: Real>(line: &HypothesisLine, index: T) -> Option<[T; 3]> {
    let d = index - T::of(f64::from(line.at));
    let pole = T::of(1.0) + d * T::of(f64::from(line.bend));
    let q = std::array::from_fn(|i| T::of(f64::from(line.origin[i])) + d * T::of(f64::from(line.slope[i])) / pole);
    let inside = pole > T::of(0.0) && q.iter().all(|q| *q >= T::of(0.0) && *q <= T::of(1.0));
    inside.then_some(q)
}

/// Returns the costs of all hypotheses, `[pixel][hypothesis]`.
pub fn costs<T: Real>(problem: &Problem<'_>) -> Vec<T> {
    let k = problem.lattice.k;
    let mut c = vec![T::default(); k];
    let mut out = Vec::with_capacity(problem.pixels.len() * problem.hypotheses.count);
    for pixel in problem.pixels {
        let codeword = *pixel as usize * k..(*pixel as usize + 1) * k;
        let line = problem.rays.ray(*pixel).line(&problem.frame, problem.center, &problem.hypotheses);
        for l in 0..problem.hypotheses.count {
            let q = point(&line, T::of(l as f64)).filter(|q| {
                let [a, b, w]: [usize; 3] = std::array::from_fn(|i| locate(q[i], problem.lit.cells[i]).0);
                let [na, _, nw] = problem.lit.cells;
                (line.range[0]..line.range[1]).contains(&(l as u32)) && problem.lit.lit[(b * na + a) * nw + w] == 1
            });
            out.push(q.map_or(T::of(f64::from(OUTSIDE)), |q| {
                spline(&problem.lattice, q, &mut c);
                misfit(problem, codeword.clone(), &c)
            }));
        }
    }
    out
}

/// Writes the k values of the lattice's spline at q in the unit cube.
pub fn spline<T: Real>(lattice: &Lattice<'_>, q: [T; 3], out: &mut [T]) {
    let k = lattice.k;
    let [a, b, w]: [(usize, T); 3] = std::array::from_fn(|i| locate(q[i], lattice.cells[i]));
    out.fill(T::default());
    for (j, wb) in weights(b.1).into_iter().enumerate() {
        for (i, wa) in weights(a.1).into_iter().enumerate() {
            for (l, ww) in weights(w.1).into_iter().enumerate() {
                let node = ((b.0 + j) * (lattice.cells[0] + 3) + a.0 + i) * (lattice.cells[2] + 3) + w.0 + l;
                for (c, v) in out.iter_mut().zip(&lattice.nodes[node * k..]) {
                    *c += wa * wb * ww * T::of(f64::from(*v));
                }
            }
        }
    }
}

/// Returns the cost that is made of E*; see [`super`].
fn misfit<T: Real>(problem: &Problem<'_>, codeword: std::ops::Range<usize>, c: &[T]) -> T {
    let zero = T::default();
    let (mut aa, mut ab, mut bb, mut f, mut g, mut e) = (zero, zero, zero, zero, zero, zero);
    for (j, c) in codeword.zip(c) {
        let [p, iv, surround] = [problem.p, problem.inv_var, problem.surround].map(|v| T::of(f64::from(v[j])));
        let (r, ambient, indirect) = (p - *c, T::of(1.0) - *c, surround - *c);
        aa += iv * ambient * ambient;
        ab += iv * ambient * indirect;
        bb += iv * indirect * indirect;
        f += iv * ambient * r;
        g += iv * indirect * r;
        e += iv * r * r;
    }
    let [pa, pb] = problem.prior.map(|p| T::of(f64::from(p)));
    let (a, b) = (aa + pa, bb + pb);
    let det = a * b - ab * ab;
    let mut x = [(b * f - ab * g) / det, (a * g - ab * f) / det];
    if x[0] < zero {
        x = [zero, (g / b).max(zero)];
    } else if x[1] < zero {
        x = [(f / a).max(zero), zero];
    }
    let [x, y] = x.map(|v| v.min(T::of(0.45)));
    let gain = T::of(2.0) * (x * f + y * g) - a * x * x - b * y * y - T::of(2.0) * ab * x * y;
    let e = (e - gain).max(zero);
    e / (T::of(1.0) + e / T::of(f64::from(problem.saturation)))
}

/// Returns the sums of the path costs of all hypotheses, `[pixel][hypothesis]`; zeros for pixels that take no part.
/// Hirschmüller 2008, Eq. 13 and 14:
///
/// ```text
/// L_r(p, d) = C(p, d) + min(L_r(p − r, d), L_r(p − r, d ± 1) + P1, min_i L_r(p − r, i) + P2) − min_i L_r(p − r, i)
/// S(p, d)   = Σ_r L_r(p, d)
/// ```
pub fn sums<T: Real>(problem: &Problem<'_>, costs: &[T]) -> Vec<T> {
    let (w, h, n) = (problem.width as i32, problem.height as i32, problem.hypotheses.count);
    let (step, jump) = (T::of(f64::from(problem.step)), T::of(f64::from(problem.jump)));
    let outside = T::of(f64::from(OUTSIDE));
    let mut slot = vec![None; problem.width * problem.height];
    for (s, pixel) in problem.pixels.iter().enumerate() {
        slot[*pixel as usize] = costs[s * n..(s + 1) * n].iter().any(|c| *c < outside).then_some(s);
    }
    let slot_at = |x: i32, y: i32| {
        if x < 0 || y < 0 || x >= w || y >= h { None } else { slot[(y * w + x) as usize] }
    };
    let least = |v: &[T]| v.iter().fold(v[0], |a, b| a.min(*b));
    let mut sums = vec![T::default(); costs.len()];
    for [dx, dy] in DIRECTIONS {
        let mut path = vec![T::default(); costs.len()];
        // Every pixel after the one that lies before it on its path.
        for y in 0..h {
            for x in 0..w {
                let (x, y) = (if dx < 0 { w - 1 - x } else { x }, if dy < 0 { h - 1 - y } else { y });
                let Some(here) = slot_at(x, y) else { continue };
                let before = slot_at(x - dx, y - dy).map(|s| path[s * n..(s + 1) * n].to_vec());
                let Some(before) = before else {
                    path[here * n..(here + 1) * n].copy_from_slice(&costs[here * n..(here + 1) * n]);
                    continue;
                };
                let least = least(&before);
                for d in 0..n {
                    let mut m = before[d].min(least + jump);
                    if d > 0 {
                        m = m.min(before[d - 1] + step);
                    }
                    if d + 1 < n {
                        m = m.min(before[d + 1] + step);
                    }
                    path[here * n + d] = costs[here * n + d] + m - least;
                }
            }
        }
        sums.iter_mut().zip(&path).for_each(|(s, p)| *s += *p);
    }
    sums
}

/// Returns the winner of every pixel.
pub fn winners<T: Real>(problem: &Problem<'_>) -> Vec<Winner> {
    let n = problem.hypotheses.count;
    let costs = costs::<T>(problem);
    let sums = sums(problem, &costs);
    let outside = T::of(f64::from(OUTSIDE));
    let winner = |(row, own): (&[T], &[T])| {
        let mut best = 0;
        for l in 1..n {
            if row[l] < row[best] {
                best = l;
            }
        }
        if own[best] >= outside {
            return Winner::NONE;
        }
        let rivals = (0..n).filter(|l| l.abs_diff(best) > NEAR).map(|l| row[l].to_f64());
        let rival = rivals.fold(f64::INFINITY, f64::min);
        let mut index = best as f64;
        if best > 0 && best + 1 < n {
            let [a, b, c] = [best - 1, best, best + 1].map(|l| row[l].to_f64());
            let bend = a - 2.0 * b + c;
            if bend > 1e-6 && a.max(c) < f64::from(OUTSIDE) {
                index += (0.5 * (a - c) / bend).clamp(-0.5, 0.5);
            }
        }
        Winner { index: index as f32, margin: ((rival - row[best].to_f64()) / DIRECTIONS.len() as f64) as f32 }
    };
    sums.chunks_exact(n).zip(costs.chunks_exact(n)).map(winner).collect()
}
