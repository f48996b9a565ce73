//! The shape of a board that is not flat, free of any form: heights that are smooth over the board.

use nalgebra::{Matrix3, Vector3};
use nelu3d_field::lattice::weights;

/// Cells of a relief along either axis of the board.
const CELLS: usize = 8;
/// Nodes along either axis.
const ALONG: usize = CELLS + 3;

/// How far a board's surface stands over its plane or its bend: a uniform bicubic B-spline over its outline, on which a
/// corner may curl and all else lie flat. The same at all positions of a sweep.
#[derive(Clone, Copy, Debug)]
pub struct Relief {
    /// Outline of the board (x0, y0, x1, y1), mm.
    extent_mm: [f64; 4],
    /// Coefficients by rows of nodes, mm; positive away from a camera that the board faces.
    pub nodes: [f64; Relief::NODES],
}

impl Relief {
    /// Number of coefficients.
    pub const NODES: usize = ALONG * ALONG;

    /// Makes the relief of a flat board.
    pub fn flat(extent_mm: [f64; 4]) -> Self {
        Self { extent_mm, nodes: [0.0; Self::NODES] }
    }

    /// Returns the coefficients that make up the height at a point of the plane, mm, by index, with their weights;
    /// beyond the outline, at its nearest point.
    pub(super) fn taps(&self, plane_mm: [f64; 2]) -> [(usize, f64); 16] {
        let [x, y] = [0, 1].map(|i| {
            let (lo, hi) = (self.extent_mm[i], self.extent_mm[i + 2]);
            let at = ((plane_mm[i] - lo) / (hi - lo)).clamp(0.0, 1.0) * CELLS as f64;
            let cell = (at as usize).min(CELLS - 1);
            (cell, weights(at - cell as f64))
        });
        std::array::from_fn(|i| ((y.0 + i / 4) * ALONG + x.0 + i % 4, y.1[i / 4] * x.1[i % 4]))
    }

    /// Returns the height at a point of the plane, mm.
    #[inline]
    pub fn height(&self, plane_mm: [f64; 2]) -> f64 {
        self.taps(plane_mm).iter().map(|(node, weight)| weight * self.nodes[*node]).sum()
    }

    /// Returns the relief of the board held the other way around, turned by 180° in its plane about its middle.
    #[must_use]
    pub fn turned(&self) -> Self {
        let mut nodes = self.nodes;
        nodes.reverse();
        Self { nodes, ..*self }
    }

    /// Adds the heights of another relief of the same board.
    pub(super) fn add(&mut self, other: &Self) {
        self.nodes.iter_mut().zip(other.nodes).for_each(|(sum, height)| *sum += height);
    }

    /// Takes off the plane from which the heights over the board are least far, in the sum of their sizes: where most
    /// of the board is flat, that is where it lies. Planes belong to the boards' poses, which the corners of the print
    /// tell.
    pub fn remove_plane(&mut self) {
        const ROUNDS: usize = 30;
        let [x0, y0, x1, y1] = self.extent_mm;
        let [cell_a, cell_b] = [(x1 - x0) / CELLS as f64, (y1 - y0) / CELLS as f64];
        // In cells from the middle.
        let at = |[x, y]: [f64; 2]| Vector3::new(1.0, (x - 0.5 * (x0 + x1)) / cell_a, (y - 0.5 * (y0 + y1)) / cell_b);
        let heights: Vec<(Vector3<f64>, f64)> = self.places().map(|place| (at(place), self.height(place))).collect();
        let least = 0.01 * (heights.iter().map(|(_, h)| h * h).sum::<f64>() / heights.len() as f64).sqrt();
        let mut plane = Vector3::zeros();
        for _ in 0..ROUNDS {
            let (mut left, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for (at, h) in &heights {
                let w = 1.0 / (h - plane.dot(at)).abs().max(least).max(f64::MIN_POSITIVE);
                left += at * at.transpose() * w;
                right += at * (w * h);
            }
            plane = left.cholesky().map_or(plane, |left| left.solve(&right));
        }
        // A spline whose coefficients are linear in their places is that linear function.
        for (i, height) in self.nodes.iter_mut().enumerate() {
            let [a, b] = [i % ALONG, i / ALONG].map(|at| at as f64 - 0.5 * (ALONG - 1) as f64);
            *height -= plane.dot(&Vector3::new(1.0, a, b));
        }
    }

    /// Places that are spread evenly over the board, mm.
    fn places(&self) -> impl Iterator<Item = [f64; 2]> {
        const ACROSS: usize = 20;
        let [x0, y0, x1, y1] = self.extent_mm;
        let part = |i: usize| (i as f64 + 0.5) / ACROSS as f64;
        (0..ACROSS * ACROSS).map(move |i| [x0 + part(i % ACROSS) * (x1 - x0), y0 + part(i / ACROSS) * (y1 - y0)])
    }

    /// Returns the largest and the root mean square height over the board, mm.
    pub(super) fn largest_and_rms_mm(&self) -> [f64; 2] {
        let heights: Vec<f64> = self.places().map(|at| self.height(at)).collect();
        let largest = heights.iter().fold(0.0, |most: f64, h| most.max(h.abs()));
        [largest, (heights.iter().map(|h| h * h).sum::<f64>() / heights.len() as f64).sqrt()]
    }

    /// Returns the second differences of neighboring coefficients along both axes, and across: what a smooth relief has
    /// little of. Each as three or four coefficients by index, with their factors.
    pub(super) fn differences() -> Vec<Vec<(usize, f64)>> {
        let mut all = Vec::new();
        for b in 0..ALONG {
            for a in 0..ALONG {
                let at = |da: usize, db: usize| (b + db) * ALONG + a + da;
                if a + 2 < ALONG {
                    all.push(vec![(at(0, 0), 1.0), (at(1, 0), -2.0), (at(2, 0), 1.0)]);
                }
                if b + 2 < ALONG {
                    all.push(vec![(at(0, 0), 1.0), (at(0, 1), -2.0), (at(0, 2), 1.0)]);
                }
                if a + 1 < ALONG && b + 1 < ALONG {
                    let factor = std::f64::consts::SQRT_2;
                    all.push(vec![(at(0, 0), factor), (at(1, 0), -factor), (at(0, 1), -factor), (at(1, 1), factor)]);
                }
            }
        }
        all
    }
}
