//! Plain form: one point at a time, the textbook sums.

use super::{Activation, MlpConfig};
use crate::Real;

/// Inputs of every layer and the network's output, for one point.
fn activations<T: Real>(config: &MlpConfig, params: &[T], x: &[T]) -> Vec<Vec<T>> {
    assert_eq!(params.len(), config.n_params());
    assert_eq!(x.len(), config.n_inputs);
    let mut layers = vec![x.to_vec()];
    let mut offset = 0;
    for (l, (n_in, n_out)) in config.layers().enumerate() {
        let weights = &params[offset..][..n_in * n_out];
        let biases = &params[offset + n_in * n_out..][..n_out];
        offset += (n_in + 1) * n_out;
        let input = &layers[l];
        let output = (0..n_out).map(|o| {
            let sum = (0..n_in).fold(biases[o], |sum, i| sum + weights[o * n_in + i] * input[i]);
            if l < config.n_hidden_layers {
                sum.max(T::of(0.0))
            } else {
                match config.output_activation {
                    Activation::Linear => sum,
                    Activation::Sigmoid => sum.sigmoid(),
                }
            }
        });
        let output = output.collect();
        layers.push(output);
    }
    layers
}

/// Writes the output of one point.
pub fn forward<T: Real>(config: &MlpConfig, params: &[T], x: &[T], out: &mut [T]) {
    out.copy_from_slice(&activations(config, params, x)[config.n_hidden_layers + 1]);
}

/// Adds to the parameters' gradient and writes the input's, given one point's output gradient.
pub fn backward<T: Real>(config: &MlpConfig, params: &[T], x: &[T], d_out: &[T], d_params: &mut [T], d_x: &mut [T]) {
    assert_eq!(d_out.len(), config.n_outputs);
    assert_eq!(d_params.len(), config.n_params());
    let zero = T::of(0.0);
    let layers = activations(config, params, x);
    let mut offset = config.n_params();
    let mut d_next = d_out.to_vec();
    let shapes: Vec<_> = config.layers().collect();
    for (l, &(n_in, n_out)) in shapes.iter().enumerate().rev() {
        offset -= (n_in + 1) * n_out;
        let (input, output) = (&layers[l], &layers[l + 1]);
        let mut d_input = vec![zero; n_in];
        for o in 0..n_out {
            let slope = if l < config.n_hidden_layers {
                T::of(if output[o] > zero { 1.0 } else { 0.0 })
            } else {
                match config.output_activation {
                    Activation::Linear => T::of(1.0),
                    Activation::Sigmoid => output[o] * (T::of(1.0) - output[o]),
                }
            };
            let d_sum = d_next[o] * slope;
            for i in 0..n_in {
                d_params[offset + o * n_in + i] += d_sum * input[i];
                d_input[i] += d_sum * params[offset + o * n_in + i];
            }
            d_params[offset + n_in * n_out + o] += d_sum;
        }
        d_next = d_input;
    }
    d_x.copy_from_slice(&d_next);
}

/// Adds to the parameters' gradient that of the derivative of Σ_o d_out\[o\] y_o along `v` (an input direction).
///
/// With ReLU the derivative is linear in each layer's weights where no unit switches: t_0 = v, t_l = 1(a_l > 0) ∘ W_l
/// t_{l−1}; biases have no part in it. This is the double backward of a loss of the input gradient g: `v` is then
/// ∂L/∂g (Eq. 6 is such a loss). Linear outputs only.
pub fn backward_gradient<T: Real>(config: &MlpConfig, params: &[T], x: &[T], d_out: &[T], v: &[T], d_params: &mut [T]) {
    assert_eq!(config.output_activation, Activation::Linear);
    assert_eq!(d_params.len(), config.n_params());
    let zero = T::of(0.0);
    let layers = activations(config, params, x);
    let shapes: Vec<_> = config.layers().collect();
    let active = |l: usize, o: usize| l == config.n_hidden_layers || layers[l + 1][o] > zero;
    let mut tangents = vec![v.to_vec()];
    let mut offset = 0;
    for (l, &(n_in, n_out)) in shapes.iter().enumerate() {
        let row = |o: usize| &params[offset + o * n_in..][..n_in];
        let along = |o: usize| row(o).iter().zip(&tangents[l]).map(|(&w, &t)| w * t).sum();
        let next = (0..n_out).map(|o| if active(l, o) { along(o) } else { zero }).collect();
        tangents.push(next);
        offset += (n_in + 1) * n_out;
    }
    let mut d_next = d_out.to_vec();
    for (l, &(n_in, n_out)) in shapes.iter().enumerate().rev() {
        offset -= (n_in + 1) * n_out;
        let mut d_tangent = vec![zero; n_in];
        for o in (0..n_out).filter(|&o| active(l, o)) {
            for i in 0..n_in {
                d_params[offset + o * n_in + i] += d_next[o] * tangents[l][i];
                d_tangent[i] += d_next[o] * params[offset + o * n_in + i];
            }
        }
        d_next = d_tangent;
    }
}
