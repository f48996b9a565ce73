//! Scatter and lazy update of a hash table: every part of it has one owner, who goes through all points in order.

use crate::adam::{self, AdamConfig, Moments};
use crate::encoding::hash_grid::HashGrid;
use crate::encoding::hash_grid::cpu::{self as hash_grid, Incoming, LINE};
use crate::memory;
use std::ops::Range;
use std::sync::Mutex;

/// Entries below which a level is not shared by several owners.
const SMALL: usize = 1 << 14;

/// What one part of a step's points sends back to the table.
#[derive(Clone, Copy)]
pub(crate) struct Part<'a, const D: usize> {
    /// The points.
    pub(crate) points: &'a [[f32; D]],
    /// Gradients of the features, `[level][point][feature]`.
    pub(crate) d: &'a [f32],
    /// See [`Incoming`].
    pub(crate) s: &'a [f32],
    /// See [`Incoming`].
    pub(crate) u: [&'a [f32]; 3],
}

/// Gradients of the parts being worked on, zero between uses; as many as were ever worked on at once.
#[derive(Debug, Default)]
pub(crate) struct Scratch(Mutex<Vec<(Vec<f32>, Vec<u8>)>>);

/// One step of a table.
pub(crate) struct TableStep<'a, 'p, const D: usize> {
    pub(crate) grid: &'a HashGrid<D>,
    /// The points' parts, in order.
    pub(crate) part: &'a (dyn Fn(usize) -> Part<'p, D> + Sync),
    pub(crate) n_parts: usize,
    pub(crate) adam: &'a AdamConfig,
    pub(crate) learning_rate: f64,
    pub(crate) step: u64,
    pub(crate) scratch: &'a Scratch,
}

impl<const D: usize> TableStep<'_, '_, D> {
    /// Does the step. Which parameters end up where depends neither on the number of threads nor on how levels are cut.
    pub(crate) fn run(&self, table: &mut [f32], moments: Moments) {
        let levels = self.grid.levels();
        // Two tasks a thread even out the levels' different costs. A level shared by several owners has its points'
        // addresses computed by each of them, so it is not done without need.
        let n_owners = (2 * rayon::current_num_threads()).div_ceil(levels.len());
        self.levels(0..levels.len(), n_owners, table, moments);
    }

    fn levels(&self, levels: Range<usize>, n_owners: usize, table: &mut [f32], moments: Moments) {
        let n_features = self.grid.config().n_features_per_level;
        if levels.len() == 1 {
            let n_entries = self.grid.levels()[levels.start].n_entries;
            let n_owners = if n_entries <= SMALL { 1 } else { n_owners };
            return self.entries(levels.start, 0..n_entries, n_owners, table, moments);
        }
        let middle = levels.start + levels.len() / 2;
        let all = self.grid.levels();
        let at = (all[middle].offset - all[levels.start].offset) * n_features;
        let (left, right) = table.split_at_mut(at);
        let (left_moments, right_moments) = moments.split_at(at);
        rayon::join(
            || self.levels(levels.start..middle, n_owners, left, left_moments),
            || self.levels(middle..levels.end, n_owners, right, right_moments),
        );
    }

    fn entries(&self, level: usize, range: Range<usize>, n_owners: usize, table: &mut [f32], moments: Moments) {
        let n_features = self.grid.config().n_features_per_level;
        if n_owners > 1 {
            let middle = range.start + (range.len() / 2).next_multiple_of(LINE);
            let at = (middle - range.start) * n_features;
            let (left, right) = table.split_at_mut(at);
            let (left_moments, right_moments) = moments.split_at(at);
            rayon::join(
                || self.entries(level, range.start..middle, n_owners / 2, left, left_moments),
                || self.entries(level, middle..range.end, n_owners - n_owners / 2, right, right_moments),
            );
            return;
        }
        let lock = || self.scratch.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let (mut gradient, mut touched) = lock().pop().unwrap_or_default();
        let n = table.len();
        if gradient.len() < n {
            gradient = memory::zeros(n);
            touched.resize(n.div_ceil(LINE), 0);
        }
        let (mine, marks) = (&mut gradient[..n], &mut touched[..n.div_ceil(LINE)]);
        for i in 0..self.n_parts {
            let Part { points, d, s, u } = (self.part)(i);
            let d = &d[level * points.len() * n_features..][..points.len() * n_features];
            hash_grid::scatter(self.grid, level, points, Incoming { d, s, u }, range.clone(), mine, marks);
        }
        adam::cpu::step_lazy(self.adam, self.learning_rate, self.step, table, moments, mine, marks);
        lock().push((gradient, touched));
    }
}
