//! The shape of a board that is not flat, free of any form: heights that are smooth over the board.

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
            (cell, cubic(at - cell as f64))
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

    /// Takes off the plane that fits the heights over the board best: it belongs to the boards' poses.
    pub fn remove_plane(&mut self) {
        // Places lie symmetrically about the middle, so that the plane's three numbers are found one by one.
        let from_middle = |at: f64, i: usize| at - 0.5 * (self.extent_mm[i] + self.extent_mm[i + 2]);
        let heights: Vec<([f64; 2], f64)> =
            self.places().map(|at| ([from_middle(at[0], 0), from_middle(at[1], 1)], self.height(at))).collect();
        let mean = heights.iter().map(|(_, h)| h).sum::<f64>() / heights.len() as f64;
        let slope = |axis: usize| {
            let sum = |of: &dyn Fn(f64, f64) -> f64| heights.iter().map(|(at, h)| of(at[axis], *h)).sum::<f64>();
            sum(&|x, h| x * h) / sum(&|x, _| x * x)
        };
        let slopes = [slope(0), slope(1)];
        let cell = |i: usize| (self.extent_mm[i + 2] - self.extent_mm[i]) / CELLS as f64;
        let cells = [cell(0), cell(1)];
        // A spline whose coefficients are linear in their places is that linear function.
        for (i, height) in self.nodes.iter_mut().enumerate() {
            let [x, y] = [i % ALONG, i / ALONG].map(|at| at as f64 - 0.5 * (ALONG - 1) as f64);
            *height -= mean + slopes[0] * x * cells[0] + slopes[1] * y * cells[1];
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

/// The weights of the four cubic B-splines at a place in a cell, 0 to 1.
fn cubic(u: f64) -> [f64; 4] {
    let v = 1.0 - u;
    let inner = |u: f64| (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0;
    [v * v * v / 6.0, inner(u), inner(v), u * u * u / 6.0]
}
