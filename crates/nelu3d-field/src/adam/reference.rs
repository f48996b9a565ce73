//! Plain form: Alg. 1 of Kingma & Ba 2015, line by line.

use super::AdamConfig;
use crate::Real;

/// Takes one step of every parameter; `step` counts from 0. `first` and `second` are the moments m and v.
pub fn step<T: Real>(
    config: &AdamConfig,
    learning_rate: f64,
    step: u64,
    params: &mut [T],
    first: &mut [T],
    second: &mut [T],
    gradient: &[T],
) {
    let (beta1, beta2) = (T::of(config.beta1), T::of(config.beta2));
    let one = T::of(1.0);
    let t = (step + 1) as f64;
    let correction1 = T::of(1.0 - config.beta1.powf(t));
    let correction2 = T::of(1.0 - config.beta2.powf(t));
    for (((p, m), v), &g) in params.iter_mut().zip(first).zip(second).zip(gradient) {
        *m = beta1 * *m + (one - beta1) * g;
        *v = beta2 * *v + (one - beta2) * g * g;
        *p -= T::of(learning_rate) * (*m / correction1) / ((*v / correction2).sqrt() + T::of(config.epsilon));
    }
}

/// Takes one step of the parameters whose gradient is not exactly zero.
pub fn step_lazy<T: Real>(
    config: &AdamConfig,
    learning_rate: f64,
    at: u64,
    params: &mut [T],
    first: &mut [T],
    second: &mut [T],
    gradient: &[T],
) {
    for i in (0..params.len()).filter(|&i| gradient[i] != T::of(0.0)) {
        let (p, m, v) = (&mut params[i..=i], &mut first[i..=i], &mut second[i..=i]);
        step(config, learning_rate, at, p, m, v, &gradient[i..=i]);
    }
}
