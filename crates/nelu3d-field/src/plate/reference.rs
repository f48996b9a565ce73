//! The plain form: conjugate gradients with a diagonal preconditioner over all pixels.

use super::{PlateStop, PlateSystem};

/// Returns (diag(h) + DᵀWD) v, plainly; with `h` left out where `data` is false.
pub fn product(system: &PlateSystem<'_>, v: &[f64], data: bool) -> Vec<f64> {
    let w = system.width;
    let mut out: Vec<f64> = (0..v.len()).map(|i| if data { f64::from(system.h[i]) * v[i] } else { 0.0 }).collect();
    for i in 0..v.len() {
        let differences: [(f32, &[(usize, f64)]); 3] = [
            (system.xx[i], &[(i.wrapping_sub(1), 1.0), (i, -2.0), (i + 1, 1.0)]),
            (system.yy[i], &[(i.wrapping_sub(w), 1.0), (i, -2.0), (i + w, 1.0)]),
            (system.xy[i], &[(i, 1.0), (i + 1, -1.0), (i + w, -1.0), (i + w + 1, 1.0)]),
        ];
        for (weight, members) in differences.into_iter().filter(|d| d.0 > 0.0) {
            let difference: f64 = members.iter().map(|(j, factor)| factor * v[*j]).sum();
            for (j, factor) in members {
                out[*j] += f64::from(weight) * factor * difference;
            }
        }
    }
    out
}

/// Returns the change δ of `x`, and the number of iterations.
pub fn solve(system: &PlateSystem<'_>, x: &[f32], until: PlateStop) -> (Vec<f64>, usize) {
    system.check(x);
    let n = x.len();
    let unit = |i: usize| system.active[i].then_some(i);
    let x: Vec<f64> = x.iter().map(|v| f64::from(*v)).collect();
    let rough = product(system, &x, false);
    let mut r: Vec<f64> =
        (0..n).map(|i| if system.active[i] { -f64::from(system.g[i]) - rough[i] } else { 0.0 }).collect();
    let diagonal = diagonal(system);
    let inverse: Vec<f64> = (0..n).map(|i| unit(i).map_or(0.0, |i| 1.0 / diagonal[i])).collect();
    let square = |r: &[f64]| -> f64 { r.iter().zip(&inverse).map(|(r, d)| r * r * d).sum() };
    let mut p: Vec<f64> = r.iter().zip(&inverse).map(|(r, d)| r * d).collect();
    let mut change = vec![0.0; n];
    let first = square(&r);
    let enough = (until.reduction * until.reduction * first)
        .max(until.settled * system.active.iter().filter(|a| **a).count() as f64);
    let mut rz = first;
    for iteration in 0..until.iterations {
        if rz <= enough {
            return (change, iteration);
        }
        let ap = product(system, &p, true);
        let step = rz / p.iter().zip(&ap).map(|(p, ap)| p * ap).sum::<f64>();
        for i in 0..n {
            change[i] += step * p[i];
            r[i] -= step * ap[i];
        }
        let next = square(&r);
        for i in 0..n {
            p[i] = r[i] * inverse[i] + next / rz * p[i];
        }
        rz = next;
    }
    (change, until.iterations)
}

/// Returns the diagonal of the matrix.
fn diagonal(system: &PlateSystem<'_>) -> Vec<f64> {
    let w = system.width;
    let mut out: Vec<f64> = system.h.iter().map(|h| f64::from(*h)).collect();
    for i in 0..out.len() {
        let [xx, yy, xy] = [system.xx[i], system.yy[i], system.xy[i]].map(f64::from);
        if xx > 0.0 {
            [(i - 1, 1.0), (i, 4.0), (i + 1, 1.0)].iter().for_each(|(j, f)| out[*j] += f * xx);
        }
        if yy > 0.0 {
            [(i - w, 1.0), (i, 4.0), (i + w, 1.0)].iter().for_each(|(j, f)| out[*j] += f * yy);
        }
        if xy > 0.0 {
            [i, i + 1, i + w, i + w + 1].iter().for_each(|j| out[*j] += xy);
        }
    }
    out
}

/// Returns Σ (½ h δ² + g δ) + ½ Σ w (D (x + δ))², what a solution minimizes.
pub fn objective(system: &PlateSystem<'_>, x: &[f32], change: &[f64]) -> f64 {
    let moved: Vec<f64> = x.iter().zip(change).map(|(x, d)| f64::from(*x) + d).collect();
    let rough = product(system, &moved, false);
    (0..x.len())
        .map(|i| {
            let d = change[i];
            0.5 * f64::from(system.h[i]) * d * d + f64::from(system.g[i]) * d + 0.5 * rough[i] * moved[i]
        })
        .sum()
}
