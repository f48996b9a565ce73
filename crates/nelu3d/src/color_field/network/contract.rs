//! The operations of a network, whatever its encoding.

use std::fmt::Debug;

use nelu3d_field::field::FieldError;
use nelu3d_field::{FrequencyField, FrequencyFieldConfig, HashField, HashFieldConfig};

/// A network over the unit cube, with its parameters and its optimizer.
pub trait Network: Clone + Debug + Sized {
    /// Encoding, network and training.
    type Config: Clone + Debug + PartialEq;

    /// Initializes the parameters.
    ///
    /// # Errors
    ///
    /// The configuration is invalid.
    fn new(config: Self::Config, seed: u64) -> Result<Self, FieldError>;

    /// Takes over parameters.
    ///
    /// # Errors
    ///
    /// The configuration is invalid, or belongs to another number of parameters.
    fn from_params(config: Self::Config, params: Vec<f32>) -> Result<Self, FieldError>;

    /// Returns all parameters.
    fn params(&self) -> &[f32];

    /// Returns the number of outputs per point.
    fn n_outputs(&self) -> usize;

    /// Evaluates the network at points, into `values` (`points × outputs`).
    fn query(&self, points: &[[f32; 3]], values: &mut [f32]);

    /// Takes one step of the optimizer on points, their target values and their weights.
    fn train_step(&mut self, points: &[[f32; 3]], targets: &[f32], weights: &[f32]);

    /// Drops the state of the optimizer.
    fn finish_training(&mut self);
}

macro_rules! impl_network {
    ($network:ty, $config:ty) => {
        impl Network for $network {
            type Config = $config;

            fn new(config: Self::Config, seed: u64) -> Result<Self, FieldError> {
                <$network>::new(config, seed)
            }

            fn from_params(config: Self::Config, params: Vec<f32>) -> Result<Self, FieldError> {
                <$network>::from_params(config, params)
            }

            fn params(&self) -> &[f32] {
                self.params()
            }

            fn n_outputs(&self) -> usize {
                self.n_outputs()
            }

            fn query(&self, points: &[[f32; 3]], values: &mut [f32]) {
                self.query(points, values);
            }

            fn train_step(&mut self, points: &[[f32; 3]], targets: &[f32], weights: &[f32]) {
                self.train_step(points, targets, weights);
            }

            fn finish_training(&mut self) {
                self.finish_training();
            }
        }
    };
}

impl_network!(HashField<3>, HashFieldConfig<3>);
impl_network!(FrequencyField, FrequencyFieldConfig);
