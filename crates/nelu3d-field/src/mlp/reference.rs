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

/// Output of one point.
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
