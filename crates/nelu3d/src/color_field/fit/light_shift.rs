//! What a field becomes where its light is elsewhere: three numbers.
//!
//! A codeword is constant along a ray of light. In the frame of a light's center the rays are the lines of constant (a,
//! b); those of a light nearby lean against them, c(a, b, w) = c₀(a + Δa, b + Δb), by an offset that is linear in the
//! distance along them, and grows with the ray's own distance from the axis as the light's distance is off:
//!
//! ```text
//! Δa = u (s₁ + s₃ x),     Δb = u (s₂ + s₃ y),        u = w − ½, x, y in cells from the middle
//! ```
//!
//! To first order that is u (s₁ + s₃ x) ∂c₀/∂a + u (s₂ + s₃ y) ∂c₀/∂b. An error of the light's center is not seen at
//! single positions, as the field follows it; it leaves codewords that seem to change along rays.

use nalgebra::Vector3;

use super::NormalEquations;

use crate::color_field::grid::Grid;

/// What a spline becomes by each of s₁ to s₃ alone, less what it is, as coefficients. Its first cell is cell `first`
/// along a and b of a field of `cells`.
pub fn changes(grid: &Grid, first: [usize; 2], cells: [usize; 2]) -> [Vec<f32>; 3] {
    let ([na, nb, nw], k) = (grid.nodes(), grid.k);
    let row = na * k;
    let mean = grid.mean_along_w();
    let mut changes: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0f32; grid.coeffs.len()]);
    let from_middle = |node: usize, i: usize| (first[i] + node) as f32 - 1.0 - cells[i] as f32 / 2.0;
    for b in 1..nb - 1 {
        for a in 1..na - 1 {
            let at = b * row + a * k;
            let (x, y) = (from_middle(a, 0), from_middle(b, 1));
            for c in at..at + k {
                let along_a = 0.5 * (mean[c + k] - mean[c - k]);
                let along_b = 0.5 * (mean[c + row] - mean[c - row]);
                for w in 0..nw {
                    let u = (w as f32 - 1.0) / (nw - 3) as f32 - 0.5;
                    let i = (b * na + a) * nw * k + w * k + (c - at);
                    changes[0][i] = u * along_a;
                    changes[1][i] = u * along_b;
                    changes[2][i] = u * (x * along_a + y * along_b);
                }
            }
        }
    }
    changes
}

/// Solves the equations of s₁ to s₃ of a field of `cells`; `None` where the samples do not tell.
///
/// Patterns that vary along one axis leave the light's place along the other open: it is held by a small part of what
/// is known of the axis that they tell.
pub fn solve(equations: &NormalEquations<3>, cells: [usize; 2]) -> Option<Vector3<f64>> {
    /// As a part of the information on the axis that is told best.
    const HELD: f64 = 1e-4;
    let known = HELD * equations.left[(0, 0)].max(equations.left[(1, 1)]);
    let half = 0.5 * cells[0].max(cells[1]) as f64;
    equations.solve(&Vector3::new(known, known, known * half * half))
}

/// How much the shifts agree that two sets of samples of a field of `cells` tell: the cosine between them as codewords
/// change with them, 1 where they are the same; `None` where one of them tells nothing.
pub fn agreement([one, other]: &[NormalEquations<3>; 2], cells: [usize; 2]) -> Option<f64> {
    let information = one.left + other.left;
    let [s, t] = [solve(one, cells)?, solve(other, cells)?];
    let product = |s: &Vector3<f64>, t: &Vector3<f64>| s.dot(&(information * t));
    let cosine = product(&s, &t) / (product(&s, &s) * product(&t, &t)).sqrt();
    cosine.is_finite().then_some(cosine)
}
