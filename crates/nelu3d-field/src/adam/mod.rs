//! Adam (Kingma & Ba 2015, Alg. 1) over flat buffers, dense or lazy, and its learning-rate schedule.
//!
//! State is both moments of every parameter, each in a buffer of its own. The caller owns the buffers and calls once
//! per parameter group, with that group's learning rate. The lazy form updates the parameters with a gradient alone and
//! leaves the others and their moments as they are (they do not decay), with the bias correction of the global step:
//! hash tables see a fraction of their entries per step (Müller et al. 2022, Sec. 4).

pub mod cpu;
pub mod reference;

use crate::memory::zeros;
use serde::{Deserialize, Serialize};

/// First and second moments of some parameters' gradients.
#[derive(Debug)]
pub struct Moments<'a> {
    /// m, per parameter.
    pub first: &'a mut [f32],
    /// v, per parameter.
    pub second: &'a mut [f32],
}

impl<'a> Moments<'a> {
    /// Returns the number of parameters.
    fn len(&self) -> usize {
        assert_eq!(self.first.len(), self.second.len());
        self.first.len()
    }

    /// Returns those of the first `n` parameters, and the rest.
    pub fn split_at(self, n: usize) -> (Self, Self) {
        let (first, first_rest) = self.first.split_at_mut(n);
        let (second, second_rest) = self.second.split_at_mut(n);
        (Self { first, second }, Self { first: first_rest, second: second_rest })
    }
}

/// Moments that own their memory; zero at the start.
#[derive(Clone, Debug, Default)]
pub struct MomentBuffers {
    /// m, per parameter.
    pub first: Vec<f32>,
    /// v, per parameter.
    pub second: Vec<f32>,
}

impl MomentBuffers {
    /// Makes the moments of `n` parameters.
    pub fn new(n: usize) -> Self {
        Self { first: zeros(n), second: zeros(n) }
    }

    /// Returns all of them.
    pub fn all(&mut self) -> Moments<'_> {
        Moments { first: &mut self.first, second: &mut self.second }
    }
}

/// Settings of the optimizer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AdamConfig {
    /// Decay of the first moment, in [0, 1).
    pub beta1: f64,
    /// Decay of the second moment, in [0, 1).
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub epsilon: f64,
}

impl Default for AdamConfig {
    /// Returns the settings of Müller et al. 2022, Sec. 4.
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.99, epsilon: 1e-15 }
    }
}

/// Linear warm-up from `warmup_start`, then exponential decay to `final_factor` at `n_steps`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Schedule {
    /// Steps of the warm-up.
    pub n_warmup_steps: u64,
    /// Factor at step 0.
    pub warmup_start: f64,
    /// Steps in all.
    pub n_steps: u64,
    /// Factor at `n_steps` and after.
    pub final_factor: f64,
}

impl Default for Schedule {
    fn default() -> Self {
        Self { n_warmup_steps: 50, warmup_start: 0.01, n_steps: 2000, final_factor: 0.1 }
    }
}

impl Schedule {
    /// Returns the factor on the learning rates at a step, counted from 0.
    pub fn factor(&self, step: u64) -> f64 {
        if step < self.n_warmup_steps {
            return self.warmup_start + (1.0 - self.warmup_start) * step as f64 / self.n_warmup_steps as f64;
        }
        let decaying = self.n_steps.saturating_sub(self.n_warmup_steps).max(1) as f64;
        let done = ((step - self.n_warmup_steps) as f64 / decaying).min(1.0);
        self.final_factor.powf(done)
    }
}

/// The factors of one update, with bias correction folded in:
/// p −= rate · m / (sqrt(v) · root + epsilon).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Update {
    pub(crate) beta1: f64,
    pub(crate) beta2: f64,
    pub(crate) epsilon: f64,
    pub(crate) rate: f64,
    pub(crate) root: f64,
}

impl Update {
    /// Returns the update at `step`, counted from 0.
    pub(crate) fn new(config: &AdamConfig, learning_rate: f64, step: u64) -> Self {
        let t = step.saturating_add(1).min(i32::MAX as u64) as i32;
        let AdamConfig { beta1, beta2, epsilon } = *config;
        let rate = learning_rate / (1.0 - beta1.powi(t));
        Self { beta1, beta2, epsilon, rate, root: 1.0 / (1.0 - beta2.powi(t)).sqrt() }
    }
}
