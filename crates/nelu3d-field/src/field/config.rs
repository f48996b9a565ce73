//! Settings of a training, and errors of a field.

use crate::adam::{AdamConfig, Schedule};
use crate::encoding::hash_grid::HashGridError;
use crate::mlp::MlpError;
use serde::{Deserialize, Serialize};

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
        "field parameters: the configuration needs {expected} values, found {found}; was the file cut off or the \
         configuration changed?"
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
    /// Returns value and derivative at a residual.
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
    /// Returns the rate of Müller et al. 2022, Sec. 4, for the table; a third of it for the network, whose loss
    /// otherwise jumps between steps.
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

/// Checks the parameters of a field.
///
/// # Errors
///
/// [`FieldError`] for a wrong number of them, or one that is not finite.
pub(super) fn check_params(params: &[f32], expected: usize) -> Result<(), FieldError> {
    if params.len() != expected {
        return Err(FieldError::Length { expected, found: params.len() });
    }
    match params.iter().position(|x| !x.is_finite()) {
        Some(index) => Err(FieldError::NotFinite { index }),
        None => Ok(()),
    }
}
