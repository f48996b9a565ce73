//! What patterns lose out of focus: four numbers for a whole field.
//!
//! A codeword changes along a ray of light by defocus only, and all rays have the same lens. To second order (Taylor) a
//! blur adds a multiple of the pattern's Laplacian, c = c₀ + β ∇²c₀, with β half of the blur's variance along one axis.
//! The diameter of a thin lens' blur is linear in the inverse distance from the light, and so is w of the light's
//! frame; where the lens is tilted against the pattern, the distance in focus is linear in a and b. So
//!
//! ```text
//! β = β₀ u² + u (β₁ + β₂ x + β₃ y),        x, y, u = a − ½, b − ½, w − ½
//! ```
//!
//! less what does not change along u, which is the pattern's own. With β known, what is left of a field is constant
//! along the light's rays, and a few boards tell it (docs/method.md, section 3.4).

use std::ops::Range;

use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use crate::color_field::grid::Grid;

/// How blur changes over a field, in squares of its cells along a.
#[derive(Clone, Debug, PartialEq)]
pub struct Defocus {
    /// β₀ to β₃ of the module's formula, in squares of a cell's size along a.
    pub beta: [f64; 4],
    /// Square of the ratio of a cell's size along a to that along b.
    pub aspect: f64,
    /// Which channels follow it. Second order says too much of waves that are a few cells long where blur is large.
    pub of_channels: Vec<bool>,
}

impl Defocus {
    /// The numbers for a window of a field of `cells` along a and b, in the window's own unit coordinates, from those
    /// of the field: a matrix.
    pub fn to_window(window: &[Range<usize>; 2], cells: [usize; 2]) -> Matrix4<f64> {
        let mut m = Matrix4::identity();
        for i in 0..2 {
            let n = cells[i] as f64;
            m[(1, 2 + i)] = (window[i].start + window[i].end) as f64 / (2.0 * n) - 0.5;
            m[(2 + i, 2 + i)] = window[i].len() as f64 / n;
        }
        m
    }

    /// Returns the defocus in the unit coordinates of a window (cells along a and b) of a field of `cells`.
    #[must_use]
    pub fn of_window(&self, window: &[Range<usize>; 2], cells: [usize; 2]) -> Self {
        Self { beta: (Self::to_window(window, cells) * Vector4::from(self.beta)).into(), ..self.clone() }
    }

    /// β in terms of its coefficients as a spline: at the node of unit coordinates x, y, u that are less by a half, in
    /// a lattice of `cells_w` along w. The coefficient of u² is less than its value by a third of a cell's square.
    fn at_node(&self, [x, y, u]: [f64; 3], cells_w: usize) -> f64 {
        let [square, along, by_x, by_y] = self.beta;
        square * (u * u - 1.0 / (3.0 * (cells_w * cells_w) as f64)) + u * (along + by_x * x + by_y * y)
    }
}

/// What a spline becomes by each of the numbers of [`Defocus::beta`] alone, less what it is, as coefficients.
pub fn changes(grid: &Grid, aspect: f64) -> [Vec<f32>; 4] {
    let unit = |i: usize| Defocus {
        beta: std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }),
        aspect,
        of_channels: vec![true; grid.k],
    };
    let laplacian = Laplacian::of(grid, &unit(0));
    std::array::from_fn(|i| {
        let mut change = vec![0.0f32; grid.coeffs.len()];
        laplacian.add(&unit(i), 1.0, &mut change);
        change
    })
}

/// The Laplacian across of a spline, as it is in the mean along w, over coefficients that are averaged with their
/// neighbors (1, 2, 1) along a and b: differences of single ones are mostly noise, and a blur takes the finest waves
/// away once, not the more the farther out of focus.
pub(super) struct Laplacian {
    nodes: [usize; 3],
    k: usize,
    /// `[b][a][k]`, in units of a cell along a.
    values: Vec<f32>,
}

impl Laplacian {
    /// Takes the Laplacian of a spline, of those channels that follow a defocus.
    pub(super) fn of(grid: &Grid, Defocus { aspect, of_channels, .. }: &Defocus) -> Self {
        let (nodes @ [na, nb, _], k) = (grid.nodes(), grid.k);
        let row = na * k;
        let mean = grid.mean_along_w();
        let mean = averaged(&averaged(&mean, k, row), row, nb * row);
        let mut values = vec![0.0f32; nb * row];
        values.par_chunks_mut(row).enumerate().filter(|(b, _)| (1..nb - 1).contains(b)).for_each(|(b, out)| {
            let [before, own, after] = [b - 1, b, b + 1].map(|b| &mean[b * row..][..row]);
            for i in k..row - k {
                let along_a = own[i - k] - 2.0 * own[i] + own[i + k];
                let along_b = before[i] - 2.0 * own[i] + after[i];
                out[i] = if of_channels[i % k] { along_a + *aspect as f32 * along_b } else { 0.0 };
            }
        });
        Self { nodes, k, values }
    }

    /// Adds `sign` times β ∇²c to coefficients.
    pub(super) fn add(&self, defocus: &Defocus, sign: f32, coeffs: &mut [f32]) {
        let ([na, nb, nw], k) = (self.nodes, self.k);
        let unit = |node: usize, nodes: usize| (node as f64 - 1.0) / (nodes - 3) as f64 - 0.5;
        coeffs.par_chunks_mut(na * nw * k).zip(self.values.par_chunks(na * k)).enumerate().for_each(
            |(b, (row, of))| {
                for (a, (column, laplacian)) in row.chunks_exact_mut(nw * k).zip(of.chunks_exact(k)).enumerate() {
                    for (w, node) in column.chunks_exact_mut(k).enumerate() {
                        let beta = sign * defocus.at_node([unit(a, na), unit(b, nb), unit(w, nw)], nw - 3) as f32;
                        node.iter_mut().zip(laplacian).for_each(|(c, l)| *c += beta * l);
                    }
                }
            },
        );
    }
}

/// Means of values with those `step` before and after in runs of `length`, weighted 1, 2, 1.
fn averaged(values: &[f32], step: usize, length: usize) -> Vec<f32> {
    let mut out = values.to_vec();
    for (out, values) in out.chunks_exact_mut(length).zip(values.chunks_exact(length)) {
        for i in step..length.saturating_sub(step) {
            out[i] = 0.25 * (values[i - step] + values[i + step]) + 0.5 * values[i];
        }
    }
    out
}
