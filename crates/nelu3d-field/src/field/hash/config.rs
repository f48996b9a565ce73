//! Settings of a hash field.

use super::super::config::{FieldError, TrainConfig};
use crate::encoding::hash_grid::{HashGrid, HashGridConfig};
use crate::mlp::{Activation, MlpConfig};
use serde::{Deserialize, Serialize};
use std::fmt;

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
    /// Whether the network also sees the point x itself, as 2x − 1, after its features.
    #[serde(default)]
    pub append_position: bool,
    /// Training.
    #[serde(default)]
    pub training: TrainConfig,
}

impl<const D: usize> HashFieldConfig<D> {
    /// Returns the settings of a small isotropic field: 8 levels of 2 features from 8 to 128 cells, 2^15 entries, 2 ×
    /// 32 units.
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

    /// Lays out the table and the network, as a field of these settings has them.
    ///
    /// # Errors
    /// [`FieldError`] for a configuration out of range.
    pub fn build(&self) -> Result<(HashGrid<D>, MlpConfig), FieldError> {
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
