use crate::check::{assert_gradient, uniform};
use nelu3d_field::mlp::weight_norm::{backward, from_weights, n_raw, to_weights};
use nelu3d_field::mlp::{Activation, MlpConfig};

fn config() -> MlpConfig {
    MlpConfig { n_inputs: 5, n_outputs: 2, width: 7, n_hidden_layers: 2, output_activation: Activation::Linear }
}

#[test]
fn weights_survive() {
    let config = config();
    let params = uniform(1, config.n_params(), -1.0, 1.0);
    let raw = from_weights(&config, &params);
    assert_eq!(raw.len(), n_raw(&config));
    let mut back = vec![0.0; params.len()];
    to_weights(&config, &raw, &mut back);
    assert!(params.iter().zip(&back).all(|(a, b)| (a - b).abs() < 1e-14));
    // A unit without weights stays one.
    let zero = vec![0.0; params.len()];
    to_weights(&config, &from_weights(&config, &zero), &mut back);
    assert!(back.iter().all(|w| *w == 0.0));
}

#[test]
fn gradients_match_central_differences() {
    let config = config();
    let raw = uniform(2, n_raw(&config), -1.0, 1.0);
    // Any smooth function of the weights.
    let slopes = uniform(3, config.n_params(), -1.0, 1.0);
    let loss = |raw: &[f64]| {
        let mut params = vec![0.0; config.n_params()];
        to_weights(&config, raw, &mut params);
        params.iter().zip(&slopes).map(|(w, s)| s * w + 0.5 * w * w).sum::<f64>()
    };
    let mut params = vec![0.0; config.n_params()];
    to_weights(&config, &raw, &mut params);
    let d_params: Vec<f64> = params.iter().zip(&slopes).map(|(w, s)| s + w).collect();
    let mut d_raw = vec![0.0; raw.len()];
    backward(&config, &raw, &d_params, &mut d_raw);
    assert_gradient(&raw, &d_raw, 1e-6, loss);
}
