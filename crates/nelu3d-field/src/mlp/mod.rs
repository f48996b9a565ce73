//! Fully connected network with biases: `n_hidden_layers` ReLU layers of `width` units and one output layer.
//!
//! Parameters are one flat buffer: per layer the weights `[n_out][n_in]`, row-major, then the biases `[n_out]`.

pub mod cpu;
mod gemm;
pub(crate) mod gradient;
pub mod reference;
pub mod weight_norm;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

/// The activation of the output layer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Activation {
    /// y = x
    #[default]
    Linear,
    /// y = 1 / (1 + e^−x)
    Sigmoid,
}

/// Shape of a network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MlpConfig {
    /// Length of an input vector, 1..=256.
    pub n_inputs: usize,
    /// Length of an output vector, 1..=256.
    pub n_outputs: usize,
    /// Units of a hidden layer, 1..=256.
    pub width: usize,
    /// Number of hidden layers, 1..=8.
    pub n_hidden_layers: usize,
    /// Activation of the output.
    pub output_activation: Activation,
}

/// An [`MlpConfig`] out of range.
#[derive(Debug, thiserror::Error, PartialEq)]
#[error("{name} of a network must be in 1..={max}, not {value}")]
pub struct MlpError {
    name: &'static str,
    max: usize,
    value: usize,
}

impl MlpConfig {
    /// Checks every size.
    ///
    /// # Errors
    /// An [`MlpError`] naming the first size out of range.
    pub fn validate(&self) -> Result<(), MlpError> {
        let sizes = [
            ("n_inputs", 256, self.n_inputs),
            ("n_outputs", 256, self.n_outputs),
            ("width", 256, self.width),
            ("n_hidden_layers", 8, self.n_hidden_layers),
        ];
        match sizes.into_iter().find(|&(_, max, value)| !(1..=max).contains(&value)) {
            Some((name, max, value)) => Err(MlpError { name, max, value }),
            None => Ok(()),
        }
    }

    /// Returns (n_in, n_out) of every layer, from input to output.
    pub fn layers(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..=self.n_hidden_layers).map(|l| {
            let n_in = if l == 0 { self.n_inputs } else { self.width };
            let n_out = if l == self.n_hidden_layers { self.n_outputs } else { self.width };
            (n_in, n_out)
        })
    }

    /// Returns the length of the parameter buffer.
    pub fn n_params(&self) -> usize {
        self.layers().map(|(n_in, n_out)| (n_in + 1) * n_out).sum()
    }

    /// Fills a parameter buffer: weights uniform with variance 2/n_in (He et al. 2015, Eq. 10) in hidden layers and
    /// 1/n_in at the output, biases zero.
    pub fn init(&self, seed: u64, params: &mut [f32]) {
        assert_eq!(params.len(), self.n_params());
        let mut rng = StdRng::seed_from_u64(seed);
        let mut rest = params;
        for (l, (n_in, n_out)) in self.layers().enumerate() {
            let (layer, tail) = rest.split_at_mut((n_in + 1) * n_out);
            rest = tail;
            let (weights, biases) = layer.split_at_mut(n_in * n_out);
            let gain = if l == self.n_hidden_layers { 1.0 } else { 2.0 };
            let limit = (3.0 * gain / n_in as f32).sqrt();
            weights.fill_with(|| rng.random_range(-limit..limit));
            biases.fill(0.0);
        }
    }
}
