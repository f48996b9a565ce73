//! Frequencies and a network.

use super::super::config::{FieldError, check_params};
use super::super::regression::{Chunk, Network, Objective};
use super::config::FrequencyFieldConfig;
use super::encoder::FrequencyEncoder;
use crate::adam::{self, MomentBuffers};
use crate::mlp::MlpConfig;
use crate::mlp::cpu::PackedMlp;

/// A learned function [0, 1]^3 → R^k: frequencies and a network.
#[derive(Clone, Debug)]
pub struct FrequencyField {
    config: FrequencyFieldConfig,
    mlp: MlpConfig,
    params: Vec<f32>,
    packed: PackedMlp,
    training: Option<Box<FrequencyTraining>>,
}

/// The state of a training beside the parameters.
#[derive(Clone, Debug, Default)]
struct FrequencyTraining {
    /// Steps done.
    n_steps: u64,
    moments: MomentBuffers,
    gradient: Vec<f32>,
    chunks: Vec<Chunk<Vec<f32>>>,
}

impl FrequencyField {
    /// Makes a field with random parameters.
    ///
    /// # Errors
    /// [`FieldError`] for a configuration out of range.
    pub fn new(config: FrequencyFieldConfig, seed: u64) -> Result<Self, FieldError> {
        let mlp = config.build()?;
        let mut params = vec![0.0; mlp.n_params()];
        mlp.init(seed, &mut params);
        Self::from_params(config, params)
    }

    /// Makes a field with given parameters, those of the network (see [`crate::mlp`]).
    ///
    /// # Errors
    /// [`FieldError`] for a configuration out of range, parameters of another length, or one that is not finite.
    pub fn from_params(config: FrequencyFieldConfig, params: Vec<f32>) -> Result<Self, FieldError> {
        let mlp = config.build()?;
        check_params(&params, mlp.n_params())?;
        let packed = PackedMlp::new(&mlp, &params);
        Ok(Self { config, mlp, params, packed, training: None })
    }

    /// Returns the configuration.
    pub fn config(&self) -> &FrequencyFieldConfig {
        &self.config
    }

    /// Returns all parameters.
    pub fn params(&self) -> &[f32] {
        &self.params
    }

    /// Returns the length of an output vector, k.
    pub fn n_outputs(&self) -> usize {
        self.mlp.n_outputs
    }

    /// Takes one step of weighted regression, as [`HashField::train_step`](crate::HashField::train_step); returns the
    /// loss before it.
    ///
    /// # Panics
    /// If a length does not fit.
    pub fn train_step(&mut self, points: &[[f32; 3]], targets: &[f32], weights: &[f32]) -> f64 {
        let k = self.n_outputs();
        assert_eq!(targets.len(), points.len() * k);
        assert!(weights.is_empty() || weights.len() == points.len());
        if points.is_empty() {
            return 0.0;
        }
        let Self { config, mlp, params, packed, training } = self;
        let FrequencyTraining { n_steps, moments, gradient, chunks } = &mut **training.get_or_insert_default();
        if gradient.len() != params.len() {
            *moments = MomentBuffers::new(params.len());
            gradient.resize(params.len(), 0.0);
        }
        let scale = 1.0 / (points.len() * k) as f32;
        let objective = Objective::Regression { loss: config.loss, weights, scale };
        let encoder = FrequencyEncoder::new(config);
        let network = Network { encoder: &encoder, mlp, packed };
        let loss = network.gradients(points, targets, objective, chunks, gradient);
        let rate = config.learning_rate * config.schedule.factor(*n_steps);
        adam::cpu::step(&config.adam, rate, *n_steps, params, moments.all(), gradient);
        packed.pack(params);
        *n_steps += 1;
        loss * f64::from(scale)
    }

    /// Frees what only training needs. A later step starts a new schedule.
    pub fn finish_training(&mut self) {
        self.training = None;
    }

    /// Writes the outputs of many points, in parallel: `out[point][output]`.
    ///
    /// # Panics
    /// If `out` does not hold `n_outputs` values per point.
    pub fn query(&self, points: &[[f32; 3]], out: &mut [f32]) {
        let encoder = FrequencyEncoder::new(&self.config);
        Network { encoder: &encoder, mlp: &self.mlp, packed: &self.packed }.query(points, out);
    }
}
