//! The optimizer's side of a training: its state, and the update once all gradients are known.

use super::config::TrainConfig;
use super::regression::Chunk;
use super::table::{Part, Scratch, TableStep};
use crate::adam::{self, MomentBuffers};
use crate::encoding::hash_grid::HashGrid;
use crate::mlp::{MlpConfig, weight_norm};

/// The state of a training beside the parameters.
#[derive(Debug, Default)]
pub(crate) struct Training {
    /// Steps done.
    pub(crate) n_steps: u64,
    /// Moments of the table, then of the network.
    pub(crate) moments: MomentBuffers,
    /// Gradient of the network's weights.
    pub(crate) network_gradient: Vec<f32>,
    /// The network's raw parameters and their gradient, if they are not its weights.
    pub(crate) raw: [Vec<f32>; 2],
    /// Scratch memory of the chunks, with the gradients of the features, `[level][point][feature]`.
    pub(super) chunks: Vec<Chunk<Vec<f32>>>,
    /// Scratch memory of the table's step.
    pub(crate) table: Scratch,
}

impl Training {
    /// Makes room for the training of these parameters.
    pub(crate) fn prepare(&mut self, settings: &TrainConfig, mlp: &MlpConfig, params: &[f32]) {
        let n_network = mlp.n_params();
        let mut n_raw = n_network;
        if settings.weight_normalization {
            n_raw = weight_norm::n_raw(mlp);
            if self.raw[0].len() != n_raw {
                self.raw[0] = weight_norm::from_weights(mlp, &params[params.len() - n_network..]);
                self.raw[1] = vec![0.0; n_raw];
            }
        }
        let n_moments = params.len() - n_network + n_raw;
        if self.moments.first.len() != n_moments {
            self.moments = MomentBuffers::new(n_moments);
        }
        self.network_gradient.resize(n_network, 0.0);
    }

    /// Makes the state of a training that was done elsewhere.
    pub(crate) fn restored(n_steps: u64, moments: MomentBuffers, raw: Vec<f32>) -> Self {
        let d_raw = vec![0.0; raw.len()];
        Self { n_steps, moments, raw: [raw, d_raw], ..Self::default() }
    }
}

impl Clone for Training {
    fn clone(&self) -> Self {
        // Scratch memory is made again where needed.
        let (n_steps, moments, raw) = (self.n_steps, self.moments.clone(), self.raw.clone());
        Self { n_steps, moments, raw, ..Self::default() }
    }
}

/// One step of the optimizer, once all gradients are known.
pub(crate) struct ParameterUpdate<'a, 'p, const D: usize> {
    pub(crate) settings: &'a TrainConfig,
    pub(crate) grid: &'a HashGrid<D>,
    pub(crate) mlp: &'a MlpConfig,
    /// What the points' parts send back to the table.
    pub(crate) part: &'a (dyn Fn(usize) -> Part<'p, D> + Sync),
    pub(crate) n_parts: usize,
}

impl<const D: usize> ParameterUpdate<'_, '_, D> {
    /// Updates the table and the network, whose gradient `training` holds, and counts the step.
    pub(crate) fn run(&self, table: &mut [f32], network: &mut [f32], training: &mut Training) {
        let Self { settings, grid, mlp, part, n_parts } = *self;
        let Training { n_steps, moments, network_gradient, raw: [raw, d_raw], table: scratch, .. } = training;
        let step = *n_steps;
        let factor = settings.schedule.factor(step);
        let (table_moments, network_moments) = moments.all().split_at(table.len());
        let learning_rate = settings.encoding_learning_rate * factor;
        TableStep { grid, part, n_parts, adam: &settings.adam, learning_rate, step, scratch }.run(table, table_moments);
        let rate = settings.network_learning_rate * factor;
        if settings.weight_normalization {
            weight_norm::backward(mlp, raw, network_gradient, d_raw);
            adam::cpu::step(&settings.adam, rate, step, raw, network_moments, d_raw);
            weight_norm::to_weights(mlp, raw, network);
        } else {
            adam::cpu::step(&settings.adam, rate, step, network, network_moments, network_gradient);
        }
        *n_steps += 1;
    }
}
