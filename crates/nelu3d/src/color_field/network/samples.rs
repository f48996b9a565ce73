//! The samples that a network is trained on.

use nelu3d_scan::statistics::median;
use rand::rngs::StdRng;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};

use crate::color_field::bins::Bins;

/// The samples that bins stand for, drawn in random order to train a network.
pub(in crate::color_field) struct TrainingSamples {
    k: usize,
    /// Unit coordinates.
    points: Vec<[f32; 3]>,
    /// Values of the points, k each.
    targets: Vec<f32>,
    /// Weight of each point: its precision relative to the median one, at most 2.
    weights: Vec<f32>,
    /// Number of neighbors that are drawn together.
    group: usize,
    rng: StdRng,
    /// Groups in the order in which they are drawn, and the next of them.
    order: Vec<u32>,
    next: usize,
}

/// The samples of one training step.
#[derive(Default)]
pub(in crate::color_field) struct SampleBatch {
    /// Unit coordinates.
    pub(in crate::color_field) points: Vec<[f32; 3]>,
    /// Values of the points, k each.
    pub(in crate::color_field) targets: Vec<f32>,
    /// Weight of each point.
    pub(in crate::color_field) weights: Vec<f32>,
}

impl TrainingSamples {
    /// Takes the samples of all filled bins, to be drawn in groups of neighbors; `None` if there are none.
    pub(in crate::color_field) fn new(bins: &Bins, group: usize, seed: u64) -> Option<Self> {
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
        let middle = median(&mut weights.clone()).expect("there are points");
        weights.iter_mut().for_each(|w| *w = (*w / middle).min(2.0));
        let order: Vec<u32> = (0..points.len().div_ceil(group) as u32).collect();
        let next = order.len();
        Some(Self { k, points, targets, weights, group, rng: StdRng::seed_from_u64(seed), order, next })
    }

    /// Returns the samples with their points moved to `place` of them.
    pub(in crate::color_field) fn at(mut self, place: impl Fn([f32; 3]) -> [f32; 3]) -> Self {
        self.points.iter_mut().for_each(|q| *q = place(*q));
        self
    }

    /// Takes every sample out with a chance of one in `one_in`, and returns those.
    ///
    /// # Panics
    ///
    /// If samples are drawn in groups.
    pub(in crate::color_field) fn hold_out(&mut self, one_in: usize, seed: u64) -> SampleBatch {
        assert_eq!(self.group, 1, "neighbors of a held-out sample are trained on");
        let (k, mut kept, mut out) = (self.k, 0, SampleBatch::default());
        let mut rng = StdRng::seed_from_u64(!seed);
        for i in 0..self.points.len() {
            let targets = i * k..(i + 1) * k;
            if rng.random_range(0..one_in) == 0 {
                out.points.push(self.points[i]);
                out.targets.extend_from_slice(&self.targets[targets]);
                out.weights.push(self.weights[i]);
            } else {
                self.points[kept] = self.points[i];
                self.targets.copy_within(targets, kept * k);
                self.weights[kept] = self.weights[i];
                kept += 1;
            }
        }
        self.points.truncate(kept);
        self.targets.truncate(kept * k);
        self.weights.truncate(kept);
        self.order = (0..kept as u32).collect();
        self.next = kept;
        out
    }

    /// Returns the number of samples.
    pub(in crate::color_field) fn len(&self) -> usize {
        self.points.len()
    }

    /// Draws at least `n` samples; each is drawn once before any is drawn twice.
    pub(in crate::color_field) fn draw(&mut self, n: usize, batch: &mut SampleBatch) {
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
