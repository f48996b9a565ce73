//! Settings of a field and of its training.

use crate::adam::{AdamConfig, Schedule};
use crate::encoding::hash_grid::{HashGrid, HashGridConfig, HashGridError};
use crate::mlp::{Activation, MlpConfig, MlpError};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Why a field cannot be made.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum FieldError {
    /// The encoding is out of range.
    #[error("field configuration: {0}")]
    Encoding(#[from] HashGridError),
    /// The network is out of range.
    #[error("field configuration: {0}")]
    Network(#[from] MlpError),
    /// Stored parameters belong to another configuration.
    #[error(
        "field parameters: the configuration needs {expected} values, found {found}; was the file cut off or the configuration changed?"
    )]
    Length {
        /// Number of parameters of the configuration.
        expected: usize,
        /// Number given.
        found: usize,
    },
    /// Stored parameters are damaged, or come from a training that diverged.
    #[error("field parameters: value {index} is not finite; train again with a lower learning rate")]
    NotFinite {
        /// Index of the first such value.
        index: usize,
    },
}

/// Loss of one residual r = output − target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum RegressionLoss {
    /// r²
    #[default]
    L2,
    /// r² up to |r| = delta, 2·delta·|r| − delta² beyond (Huber 1964, scaled to agree with L2).
    Huber {
        /// Where the parabola becomes a line.
        delta: f32,
    },
}

impl RegressionLoss {
    /// Value and derivative at a residual.
    #[inline(always)]
    pub fn at(self, r: f32) -> (f32, f32) {
        match self {
            Self::L2 => (r * r, 2.0 * r),
            Self::Huber { delta } => {
                let clipped = r.clamp(-delta.abs(), delta.abs());
                (clipped * (2.0 * r - clipped), 2.0 * clipped)
            }
        }
    }
}

/// How a field is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainConfig {
    /// Loss of a residual.
    pub loss: RegressionLoss,
    /// Optimizer.
    pub adam: AdamConfig,
    /// Learning rate of the hash table.
    pub encoding_learning_rate: f64,
    /// Learning rate of the network.
    pub network_learning_rate: f64,
    /// Factor on both, by step.
    pub schedule: Schedule,
    /// Whether the optimizer sees the network through [`crate::mlp::weight_norm`].
    pub weight_normalization: bool,
}

impl Default for TrainConfig {
    /// The rate of Müller et al. 2022, Sec. 4, for the table; a third of it for the network, whose loss otherwise jumps
    /// between steps.
    fn default() -> Self {
        Self {
            loss: RegressionLoss::L2,
            adam: AdamConfig::default(),
            encoding_learning_rate: 1e-2,
            network_learning_rate: 3e-3,
            schedule: Schedule::default(),
            weight_normalization: false,
        }
    }
}

/// Everything that determines a field apart from its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HashFieldConfig<const D: usize = 3> {
    /// Encoding of the point.
    pub encoding: HashGridConfig<D>,
    /// Length of an output vector, k.
    pub n_outputs: usize,
    /// Units of a hidden layer.
    pub width: usize,
    /// Number of hidden layers.
    pub n_hidden_layers: usize,
    /// Activation of the output.
    #[serde(default)]
    pub output_activation: Activation,
    /// Whether the network also sees the point itself, after its features.
    #[serde(default)]
    pub append_position: bool,
    /// Training.
    #[serde(default)]
    pub training: TrainConfig,
}

impl<const D: usize> HashFieldConfig<D> {
    /// A small isotropic field: 8 levels of 2 features from 8 to 128 cells, 2^15 entries, 2 × 32 units.
    pub fn small(n_outputs: usize) -> Self {
        let encoding = HashGridConfig {
            n_levels: 8,
            n_features_per_level: 2,
            log2_hashmap_size: 15,
            base_resolution: [8; D],
            finest_resolution: [128; D],
        };
        Self {
            encoding,
            n_outputs,
            width: 32,
            n_hidden_layers: 2,
            output_activation: Activation::Linear,
            append_position: false,
            training: TrainConfig::default(),
        }
    }

    pub(crate) fn build(&self) -> Result<(HashGrid<D>, MlpConfig), FieldError> {
        let grid = HashGrid::new(&self.encoding)?;
        let mlp = MlpConfig {
            n_inputs: grid.n_features() + if self.append_position { D } else { 0 },
            n_outputs: self.n_outputs,
            width: self.width,
            n_hidden_layers: self.n_hidden_layers,
            output_activation: self.output_activation,
        };
        mlp.validate()?;
        Ok((grid, mlp))
    }
}

impl<const D: usize> fmt::Display for HashFieldConfig<D> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let e = &self.encoding;
        write!(
            f,
            "hash grid {}x{} {:?}..{:?} 2^{} + mlp {}x{} -> {}",
            e.n_levels,
            e.n_features_per_level,
            e.base_resolution,
            e.finest_resolution,
            e.log2_hashmap_size,
            self.n_hidden_layers,
            self.width,
            self.n_outputs
        )
    }
}
