//! Settings of a frequency field.

use super::super::config::{FieldError, RegressionLoss};
use crate::adam::{AdamConfig, Schedule};
use crate::mlp::{Activation, MlpConfig};
use serde::{Deserialize, Serialize};

/// Octaves beyond which single-precision points no longer vary within a period.
pub(super) const MAX_OCTAVES: usize = 24;

/// Everything that determines a field apart from its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrequencyFieldConfig {
    /// Octaves of each axis, at most 24; an axis of 0 is only seen as the point's own coordinate.
    pub n_frequencies: [usize; 3],
    /// Length of an output vector, k.
    pub n_outputs: usize,
    /// Units of a hidden layer.
    pub width: usize,
    /// Number of hidden layers.
    pub n_hidden_layers: usize,
    /// Loss of a residual.
    #[serde(default)]
    pub loss: RegressionLoss,
    /// Optimizer.
    #[serde(default)]
    pub adam: AdamConfig,
    /// Learning rate.
    pub learning_rate: f64,
    /// Factor on it, by step.
    #[serde(default)]
    pub schedule: Schedule,
}

impl FrequencyFieldConfig {
    /// Returns the settings with the paper's encoding: 20 octaves on every axis.
    pub fn paper(n_outputs: usize) -> Self {
        Self {
            n_frequencies: [20; 3],
            n_outputs,
            width: 128,
            n_hidden_layers: 4,
            loss: RegressionLoss::L2,
            adam: AdamConfig::default(),
            learning_rate: 2e-3,
            schedule: Schedule::default(),
        }
    }

    /// Returns the number of features of a point: per axis and octave sine and cosine, then the point itself.
    fn n_inputs(&self) -> usize {
        2 * self.n_frequencies.iter().map(|n| (*n).min(MAX_OCTAVES)).sum::<usize>() + 3
    }

    /// Lays out the network, as a field of these settings has it.
    ///
    /// # Errors
    /// [`FieldError`] for a configuration out of range.
    pub fn build(&self) -> Result<MlpConfig, FieldError> {
        let mlp = MlpConfig {
            n_inputs: self.n_inputs(),
            n_outputs: self.n_outputs,
            width: self.width,
            n_hidden_layers: self.n_hidden_layers,
            output_activation: Activation::Linear,
        };
        mlp.validate()?;
        Ok(mlp)
    }
}
