//! Plain form: Alg. 1 of Kingma & Ba 2015, line by line.

use super::AdamConfig;
use crate::Real;

/// One step of every parameter; `step` counts from 0. `moments[i]` is `[m, v]` of `params[i]`.
pub fn step<T: Real>(
    config: &AdamConfig,
    learning_rate: f64,
    step: u64,
    params: &mut [T],
    moments: &mut [[T; 2]],
    gradient: &[T],
) {
    let (beta1, beta2) = (T::of(config.beta1), T::of(config.beta2));
    let one = T::of(1.0);
    let t = (step + 1) as f64;
    let correction1 = T::of(1.0 - config.beta1.powf(t));
    let correction2 = T::of(1.0 - config.beta2.powf(t));
    for ((p, [m, v]), &g) in params.iter_mut().zip(moments).zip(gradient) {
        *m = beta1 * *m + (one - beta1) * g;
        *v = beta2 * *v + (one - beta2) * g * g;
        *p -= T::of(learning_rate) * (*m / correction1) / ((*v / correction2).sqrt() + T::of(config.epsilon));
    }
}

/// One step of the entries whose bit is set: bit `e % 64` of `touched[e / 64]` stands for the parameters
/// `e · n_features ..` of entry e.
#[expect(clippy::too_many_arguments)]
pub fn step_lazy<T: Real>(
    config: &AdamConfig,
    learning_rate: f64,
    at: u64,
    n_features: usize,
    params: &mut [T],
    moments: &mut [[T; 2]],
    gradient: &[T],
    touched: &[u64],
) {
    for entry in (0..params.len() / n_features).filter(|e| touched[e / 64] >> (e % 64) & 1 == 1) {
        let range = entry * n_features..(entry + 1) * n_features;
        step(config, learning_rate, at, &mut params[range.clone()], &mut moments[range.clone()], &gradient[range]);
    }
}
