//! What the two forms with a network share: their samples, and how they become a spline.

use rand::SeedableRng;
use rand::rngs::StdRng;
use rand::seq::SliceRandom;

use super::bins::Bins;
use super::grid::Grid;

/// What the bins stand for, as a network is trained on it.
pub(super) struct Samples {
    k: usize,
    /// Unit coordinates.
    points: Vec<[f32; 3]>,
    /// k values a point.
    targets: Vec<f32>,
    /// Precision relative to the others'.
    weights: Vec<f32>,
    /// Neighbors drawn together.
    group: usize,
    rng: StdRng,
    order: Vec<u32>,
    next: usize,
}

/// A batch of samples.
#[derive(Default)]
pub(super) struct Batch {
    pub(super) points: Vec<[f32; 3]>,
    pub(super) targets: Vec<f32>,
    pub(super) weights: Vec<f32>,
}

impl Samples {
    /// The samples of all filled bins, to be drawn in groups of neighbors; `None` if there are none.
    pub(super) fn of(bins: &Bins, group: usize, seed: u64) -> Option<Self> {
        let k = bins.k();
        let (mut points, mut targets, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        bins.for_each_sample(|q, values, omegas| {
            // A missing channel has no value to learn; few samples lack one.
            if omegas.iter().all(|w| *w > 0.0) {
                points.push(q);
                targets.extend_from_slice(values);
                weights.push(omegas.iter().sum::<f32>() / k as f32);
            }
        });
        if points.is_empty() {
            return None;
        }
        // Precisions span decades; beyond the median one the field's own error dominates the sensor's.
        let mut sorted = weights.clone();
        let mid = sorted.len() / 2;
        let median = *sorted.select_nth_unstable_by(mid, f32::total_cmp).1;
        weights.iter_mut().for_each(|w| *w = (*w / median).min(2.0));
        let order: Vec<u32> = (0..points.len().div_ceil(group) as u32).collect();
        let next = order.len();
        Some(Self { k, points, targets, weights, group, rng: StdRng::seed_from_u64(seed), order, next })
    }

    /// Number of samples.
    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// Draws at least `n` samples; every one once before any twice.
    pub(super) fn draw(&mut self, n: usize, batch: &mut Batch) {
        let k = self.k;
        batch.points.clear();
        batch.targets.clear();
        batch.weights.clear();
        while batch.points.len() < n {
            if self.next == self.order.len() {
                self.order.shuffle(&mut self.rng);
                self.next = 0;
            }
            let from = self.order[self.next] as usize * self.group;
            let to = (from + self.group).min(self.points.len());
            self.next += 1;
            batch.points.extend_from_slice(&self.points[from..to]);
            batch.targets.extend_from_slice(&self.targets[from * k..to * k]);
            batch.weights.extend_from_slice(&self.weights[from..to]);
        }
    }
}

/// The spline through a function's values at the corners of the volume's cells, with no curvature at its ends.
/// `query(points, values)` evaluates the function.
pub(super) fn spline_through(cells: [usize; 3], k: usize, query: impl Fn(&[[f32; 3]], &mut [f32])) -> Grid {
    let mut grid = Grid::new(cells, k);
    let nodes @ [na, nb, nw] = grid.nodes();
    let at = |i: usize, n: usize| ((i as f32 - 1.0) / n as f32).clamp(0.0, 1.0);
    let points: Vec<[f32; 3]> = (0..nb * na * nw)
        .map(|i| [at(i / nw % na, cells[0]), at(i / nw / na, cells[1]), at(i % nw, cells[2])])
        .collect();
    let mut values = vec![0.0; points.len() * k];
    query(&points, &mut values);
    for (axis, stride) in [(0, nw * k), (1, na * nw * k), (2, k)] {
        values_to_coeffs(&mut values, stride, nodes[axis]);
    }
    grid.coeffs = values;
    grid
}

/// Along one axis, turns values at the nodes of a uniform cubic B-spline into its coefficients, in place: the `n` nodes of
/// a line lie `stride` apart, the first and last outside the interval, whose values are not read.
///
/// Interior: `(c₋ + 4 c + c₊) / 6 = v`. At the ends of the interval the second derivative `c₋ − 2 c + c₊` is 0, so
/// `c = v` there. The rest is a tridiagonal system, solved by elimination.
fn values_to_coeffs(values: &mut [f32], stride: usize, n: usize) {
    // The first and last node inside the interval.
    let (first, last) = (1, n - 2);
    for line in values.chunks_exact_mut(n * stride) {
        let mut upper = vec![0.0; n];
        for i in first + 1..last {
            upper[i] = 1.0 / (4.0 - upper[i - 1]);
            let (before, here) = line.split_at_mut(i * stride);
            for (v, below) in here[..stride].iter_mut().zip(&before[(i - 1) * stride..]) {
                *v = (6.0 * *v - below) * upper[i];
            }
        }
        for i in (first + 1..last).rev() {
            let (here, after) = line.split_at_mut((i + 1) * stride);
            for (v, above) in here[i * stride..].iter_mut().zip(&after[..stride]) {
                *v -= upper[i] * above;
            }
        }
        for i in 0..stride {
            let at = |node: usize| node * stride + i;
            line[at(0)] = 2.0 * line[at(1)] - line[at(2)];
            line[at(n - 1)] = 2.0 * line[at(n - 2)] - line[at(n - 3)];
        }
    }
}
