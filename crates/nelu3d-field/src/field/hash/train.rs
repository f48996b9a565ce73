//! One training step: weighted regression of the outputs on targets.
//!
//! After the gradients of all points ([`super::super::regression`]), every part of the table is owned by one task,
//! which scatters all points' gradients into it and updates the lines it touched ([`super::super::table`]). Neither
//! depends on the number of threads.

use super::super::regression::{CHUNK, Network, Objective};
use super::super::table::Part;
use super::super::training::ParameterUpdate;
use super::encoder::HashEncoder;
use super::field::HashField;
use crate::adam::MomentBuffers;

impl<const D: usize> HashField<D> {
    /// [`HashField::train_step`] in any dimension.
    pub(crate) fn regress(&mut self, points: &[[f32; D]], targets: &[f32], weights: &[f32]) -> f64 {
        assert!(weights.is_empty() || weights.len() == points.len());
        let loss = self.config.training.loss;
        let scale = 1.0 / (points.len() * self.n_outputs()).max(1) as f32;
        self.step(points, targets, Objective::Regression { loss, weights, scale }) * scale as f64
    }

    /// [`HashField::descend`] in any dimension.
    pub(super) fn descend_along(&mut self, points: &[[f32; D]], d_outputs: &[f32]) {
        self.step(points, d_outputs, Objective::Given);
    }

    /// Takes one step; returns the sum over the points' losses. `per_output` has a target, or a gradient, per output.
    fn step(&mut self, points: &[[f32; D]], per_output: &[f32], objective: Objective) -> f64 {
        let k = self.n_outputs();
        assert_eq!(per_output.len(), points.len() * k);
        if points.is_empty() {
            return 0.0;
        }
        let Self { config, grid, mlp, params, packed, training } = self;
        let training = &mut **training.get_or_insert_default();
        training.prepare(&config.training, mlp, params);
        let (table, network) = params.split_at_mut(grid.n_params());
        let mut chunks = std::mem::take(&mut training.chunks);
        let encoder = HashEncoder { grid, table, append: config.append_position };
        let gradient = &mut training.network_gradient;
        let loss =
            Network { encoder: &encoder, mlp, packed }.gradients(points, per_output, objective, &mut chunks, gradient);
        let part = |i: usize| {
            let points = &points[i * CHUNK..points.len().min((i + 1) * CHUNK)];
            let d = &chunks[i].encoding[..points.len() * grid.n_features()];
            Part { points, d, s: &[], u: [&[]; 3] }
        };
        let n_parts = points.len().div_ceil(CHUNK);
        ParameterUpdate { settings: &config.training, grid, mlp, part: &part, n_parts }.run(table, network, training);
        packed.pack(network);
        training.chunks = chunks;
        loss
    }

    /// Returns the training steps done since the field was made or restored.
    pub fn n_steps(&self) -> u64 {
        self.training.as_ref().map_or(0, |t| t.n_steps)
    }

    /// Returns the optimizer's moments: of the table, then of the network's raw parameters (see
    /// [`crate::mlp::weight_norm`]; its weights where they are not normalized). `None` where no step was taken, or the
    /// training is finished.
    pub fn moments(&self) -> Option<&MomentBuffers> {
        self.training.as_ref().map(|t| &t.moments)
    }

    /// Frees what only training needs (about three times the parameters). A later step starts a new schedule.
    pub fn finish_training(&mut self) {
        self.training = None;
    }
}
