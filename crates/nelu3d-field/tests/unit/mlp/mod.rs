mod weight_norm;

use crate::check::{assert_close, assert_gradient, uniform, uniform_f32};
use nelu3d_field::mlp::{Activation, MlpConfig, cpu, reference};

fn config(n_inputs: usize, width: usize, n_outputs: usize, output_activation: Activation) -> MlpConfig {
    MlpConfig { n_inputs, n_outputs, width, n_hidden_layers: 2, output_activation }
}

#[test]
fn reference_gradients_match_central_differences() {
    for activation in [Activation::Linear, Activation::Sigmoid] {
        let c = config(5, 12, 3, activation);
        let params = uniform(1, c.n_params(), -0.7, 0.7);
        let x = uniform(2, 5, -1.0, 1.0);
        let d_out = uniform(3, 3, -1.0, 1.0);
        let loss = |params: &[f64], x: &[f64]| {
            let mut out = [0.0; 3];
            reference::forward(&c, params, x, &mut out);
            out.iter().zip(&d_out).map(|(a, b)| a * b).sum::<f64>()
        };
        let mut d_params = vec![0.0; params.len()];
        let mut d_x = vec![0.0; 5];
        reference::backward(&c, &params, &x, &d_out, &mut d_params, &mut d_x);
        // Small steps: a ReLU must not change sides.
        assert_gradient(&params, &d_params, 1e-5, |p| loss(p, &x));
        assert_gradient(&x, &d_x, 1e-5, |x| loss(&params, x));
    }
}

#[test]
fn reference_double_backward_matches_central_differences() {
    let c = config(5, 12, 2, Activation::Linear);
    let params = uniform(1, c.n_params(), -0.7, 0.7);
    let x = uniform(2, 5, -1.0, 1.0);
    let (d_out, v) = (uniform(3, 2, -1.0, 1.0), uniform(4, 5, -1.0, 1.0));
    // The derivative along v, from the first backward pass.
    let loss = |params: &[f64]| {
        let mut d_x = vec![0.0; 5];
        reference::backward(&c, params, &x, &d_out, &mut vec![0.0; params.len()], &mut d_x);
        d_x.iter().zip(&v).map(|(d, v)| d * v).sum::<f64>()
    };
    let mut d_params = vec![0.0; params.len()];
    reference::backward_gradient(&c, &params, &x, &d_out, &v, &mut d_params);
    assert_gradient(&params, &d_params, 1e-5, loss);
}

#[test]
fn cpu_matches_reference() {
    for (n_inputs, width, n_outputs) in [(16, 64, 3), (32, 64, 1), (5, 16, 11), (9, 33, 8), (1, 1, 1), (16, 48, 17)] {
        for activation in [Activation::Linear, Activation::Sigmoid] {
            for n in [0, 1, 11, 12, 96, 97, 250] {
                let c = config(n_inputs, width, n_outputs, activation);
                let mut params = vec![0.0; c.n_params()];
                c.init(1, &mut params);
                // Biases matter too.
                params.iter_mut().zip(uniform_f32(5, c.n_params(), -0.1, 0.1)).for_each(|(p, x)| *p += x);
                let x = uniform_f32(2, n * n_inputs, -1.0, 1.0);
                let d_out = uniform_f32(3, n * n_outputs, -1.0, 1.0);
                let packed = cpu::PackedMlp::new(&c, &params);

                // Three layers of sums of up to 65 terms of order 1; a ReLU within rounding of 0 changes a point's
                // gradient by as little.
                let eps = f32::EPSILON * 3.0 * 65.0;
                let (mut fast, mut slow) = (vec![0.0; n * n_outputs], vec![0.0; n * n_outputs]);
                cpu::forward(&packed, &x, &mut fast);
                for (x, out) in x.chunks_exact(n_inputs).zip(slow.chunks_exact_mut(n_outputs)) {
                    reference::forward(&c, &params, x, out);
                }
                assert_close(&fast, &slow, eps);

                let mut gradient = cpu::MlpGradient::new(&packed);
                let mut d_x = vec![0.0; x.len()];
                cpu::backward(&packed, &x, &d_out, &mut gradient, &mut d_x);
                let mut fast = vec![0.0; params.len()];
                gradient.add_to(&packed, &mut fast);
                let (mut slow, mut slow_d_x) = (vec![0.0; params.len()], vec![0.0; x.len()]);
                let rows = x.chunks_exact(n_inputs).zip(d_out.chunks_exact(n_outputs));
                for ((x, d_out), d_x) in rows.zip(slow_d_x.chunks_exact_mut(n_inputs)) {
                    reference::backward(&c, &params, x, d_out, &mut slow, d_x);
                }
                assert_close(&d_x, &slow_d_x, eps);
                assert_close(&fast, &slow, eps * 4.0);
            }
        }
    }
}

#[test]
fn bad_configurations_are_errors() {
    assert!(config(16, 64, 3, Activation::Linear).validate().is_ok());
    let message = config(16, 0, 3, Activation::Linear).validate().unwrap_err().to_string();
    assert_eq!(message, "width of a network must be in 1..=256, not 0");
    assert!(config(257, 64, 3, Activation::Linear).validate().is_err());
}
