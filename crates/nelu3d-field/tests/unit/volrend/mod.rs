mod midpoint;

use crate::check::{assert_close, assert_gradient, uniform, uniform_f32};
use nelu3d_field::Real;
use nelu3d_field::volrend::{cpu, reference};

/// Signed distances of a ray that goes through two walls, with noise.
fn ray(seed: u64, n: usize) -> Vec<f64> {
    let noise = uniform(seed, n, -0.1, 0.1);
    (0..n).map(|j| (j as f64 / n as f64 * 9.0 + seed as f64).cos() * 0.8 + noise[j]).collect()
}

#[test]
fn weights_follow_neus_equation_13() {
    let sdf = ray(1, 20);
    let inv_s = 6.0;
    let phi: Vec<f64> = sdf.iter().map(|f| 1.0 / (1.0 + (-inv_s * f).exp())).collect();
    let mut weights = vec![0.0; 20];
    reference::render_weights(&sdf, inv_s, &mut weights);
    let mut transmittance = 1.0;
    for j in 0..19 {
        let alpha = ((phi[j] - phi[j + 1]) / phi[j]).clamp(0.0, 1.0);
        assert!((weights[j] - transmittance * alpha).abs() < 1e-14);
        transmittance *= 1.0 - alpha;
    }
    assert_eq!(weights[19], 0.0);
}

#[test]
fn reference_gradients_match_central_differences() {
    for seed in 0..4 {
        let (sdf, inv_s) = (ray(seed, 24), 5.0);
        let (k, values, d_out) = (2, uniform(seed + 10, 48, -1.0, 1.0), uniform(seed + 20, 2, -1.0, 1.0));
        let loss = |sdf: &[f64], inv_s: f64, values: &[f64]| {
            let mut weights = vec![0.0; sdf.len()];
            reference::render_weights(sdf, inv_s, &mut weights);
            let mut out = vec![0.0; k];
            reference::accumulate(&weights, values, &mut out);
            let image: f64 = out.iter().zip(&d_out).map(|(a, b)| a * b).sum();
            image + 0.7 * reference::log_transmittance(sdf, inv_s)
        };
        let mut weights = vec![0.0; sdf.len()];
        reference::render_weights(&sdf, inv_s, &mut weights);
        let (mut d_weights, mut d_values) = (vec![0.0; sdf.len()], vec![0.0; values.len()]);
        reference::accumulate_backward(&weights, &values, &d_out, &mut d_weights, &mut d_values);
        let mut d_sdf = vec![0.0; sdf.len()];
        let d_inv_s = reference::render_weights_backward(&sdf, inv_s, &d_weights, 0.7, &mut d_sdf);
        assert_gradient(&sdf, &d_sdf, 1e-5, |f| loss(f, inv_s, &values));
        assert_gradient(&[inv_s], &[d_inv_s], 1e-4, |s| loss(&sdf, s[0], &values));
        assert_gradient(&values, &d_values, 1e-3, |v| loss(&sdf, inv_s, v));
    }
}

/// The form of docs/method.md, with its division by 1 − alpha, where that is harmless.
#[test]
fn backward_equals_the_published_form() {
    let (sdf, inv_s) = (ray(2, 16), 4.0);
    let g = uniform(3, 16, -1.0, 1.0);
    let phi: Vec<f64> = sdf.iter().map(|&f| (inv_s * f).sigmoid()).collect();
    let mut weights = vec![0.0; 16];
    reference::render_weights(&sdf, inv_s, &mut weights);
    let mut expected = vec![0.0; 16];
    let mut transmittance = 1.0;
    for j in 0..15 {
        let alpha = (1.0 - phi[j + 1] / phi[j]).max(0.0);
        let after: f64 = (j + 1..16).map(|l| weights[l] * g[l]).sum();
        let d_alpha = transmittance * g[j] - after / (1.0 - alpha);
        if phi[j] > phi[j + 1] {
            expected[j] += d_alpha * phi[j + 1] / phi[j] * inv_s * (1.0 - phi[j]);
            expected[j + 1] -= d_alpha * inv_s * phi[j + 1] * (1.0 - phi[j + 1]) / phi[j];
        }
        transmittance *= 1.0 - alpha;
    }
    let mut d_sdf = vec![0.0; 16];
    reference::render_weights_backward(&sdf, inv_s, &g, 0.0, &mut d_sdf);
    for (a, b) in d_sdf.iter().zip(&expected) {
        assert!((a - b).abs() < 1e-12);
    }
}

#[test]
fn cpu_matches_reference_on_packed_rays_of_any_length() {
    let mut offsets = vec![0];
    let mut sdf = Vec::new();
    for r in 0..700u64 {
        // 0, 1, 2, … samples; 700 rays are more than one task's share.
        sdf.extend(ray(r, (r % 40) as usize).iter().map(|&f| f as f32));
        offsets.push(sdf.len());
    }
    let (n, k, inv_s) = (sdf.len(), 3, 7.0f32);
    let values = uniform_f32(1, n * k, -1.0, 1.0);
    let d_out = uniform_f32(2, 700 * k, -1.0, 1.0);
    let mut weights = vec![9.0; n];
    let (mut out, mut opacity) = (vec![9.0; 700 * k], vec![9.0; 700]);
    let (mut d_weights, mut d_values, mut d_sdf) = (vec![0.0; n], vec![0.0; n * k], vec![9.0; n]);
    cpu::render_weights(&offsets, &sdf, inv_s, &mut weights);
    cpu::accumulate(&offsets, &weights, &values, k, &mut out);
    cpu::opacity(&offsets, &weights, &mut opacity);
    cpu::accumulate_backward(&offsets, &weights, &values, &d_out, k, &mut d_weights, &mut d_values);
    let d_inv_s = cpu::render_weights_backward(&offsets, &sdf, inv_s, &weights, &d_weights, &mut d_sdf);

    let wide = |x: &[f32]| x.iter().map(|&x| x as f64).collect::<Vec<_>>();
    let narrow = |x: &[f64]| x.iter().map(|&x| x as f32).collect::<Vec<_>>();
    let mut expected_d_inv_s = 0.0;
    // Weights are rounded once, what is made of them once or a few times more; inv_s scales the last.
    let eps = 4.0 * f32::EPSILON;
    for r in 0..700 {
        let (s, v) = (offsets[r]..offsets[r + 1], offsets[r] * k..offsets[r + 1] * k);
        let (f, c) = (wide(&sdf[s.clone()]), wide(&values[v.clone()]));
        let mut w = vec![0.0; f.len()];
        reference::render_weights(&f, inv_s as f64, &mut w);
        assert_close(&weights[s.clone()], &narrow(&w), eps);
        let mut sums = vec![0.0; k];
        reference::accumulate(&w, &c, &mut sums);
        assert_close(&out[r * k..][..k], &narrow(&sums), eps);
        assert_close(&[opacity[r]], &[w.iter().sum::<f64>() as f32], eps);
        let (mut dw, mut dc, mut df) = (vec![0.0; f.len()], vec![0.0; c.len()], vec![0.0; f.len()]);
        reference::accumulate_backward(&w, &c, &wide(&d_out[r * k..][..k]), &mut dw, &mut dc);
        expected_d_inv_s += reference::render_weights_backward(&f, inv_s as f64, &dw, 0.0, &mut df);
        assert_close(&d_weights[s.clone()], &narrow(&dw), eps);
        assert_close(&d_values[v], &narrow(&dc), eps);
        assert_close(&d_sdf[s], &narrow(&df), eps * inv_s);
    }
    assert!((d_inv_s - expected_d_inv_s).abs() < 700.0 * eps as f64, "{d_inv_s} against {expected_d_inv_s}");
}

#[test]
fn extreme_distances_stay_finite_and_opaque() {
    for inv_s in [1.0f32, 1e4] {
        let sdf = [1e4 / inv_s, -1e4 / inv_s, 1e4 / inv_s, -1e4 / inv_s, 0.0];
        let offsets = [0, 5];
        let (mut weights, mut d_sdf) = ([0.0; 5], [0.0; 5]);
        cpu::render_weights(&offsets, &sdf, inv_s, &mut weights);
        assert_eq!(weights, [1.0, 0.0, 0.0, 0.0, 0.0]);
        let d = cpu::render_weights_backward(&offsets, &sdf, inv_s, &weights, &[1.0, -2.0, 3.0, 4.0, 5.0], &mut d_sdf);
        assert!(d.is_finite() && d_sdf.iter().all(|x| x.is_finite()), "{d} {d_sdf:?}");
        let wide = sdf.map(|x| x as f64);
        let mut d_wide = [0.0; 5];
        let d = reference::render_weights_backward(&wide, inv_s as f64, &[1.0, -2.0, 3.0, 4.0, 5.0], 0.0, &mut d_wide);
        assert!(d.is_finite() && d_wide.iter().all(|x| x.is_finite()));
    }
}

/// Deep inside, Φ underflows but its ratio does not: the weights still follow the distances.
#[test]
fn deep_inside_the_gradient_is_that_of_an_exponential() {
    let (sdf, inv_s) = ([-500.0f32, -500.5, -501.5], 2.0);
    let mut weights = [0.0; 3];
    cpu::render_weights(&[0, 3], &sdf, inv_s, &mut weights);
    let (a, b) = (1.0 - (-1.0f32).exp(), 1.0 - (-2.0f32).exp());
    assert_close(&weights, &[a, (1.0 - a) * b, 0.0], 4.0 * f32::EPSILON);
}

#[test]
fn no_rays_no_samples_one_sample() {
    cpu::render_weights(&[0], &[], 1.0, &mut []);
    assert_eq!(cpu::render_weights_backward(&[0, 0], &[], 1.0, &[], &[], &mut []), 0.0);
    let (mut weights, mut d_sdf, mut out) = ([9.0], [9.0], [9.0]);
    cpu::render_weights(&[0, 1], &[-1.0], 10.0, &mut weights);
    assert_eq!(cpu::render_weights_backward(&[0, 1], &[-1.0], 10.0, &weights, &[5.0], &mut d_sdf), 0.0);
    cpu::accumulate(&[0, 1], &weights, &[3.0], 1, &mut out);
    assert_eq!((weights, d_sdf, out), ([0.0], [0.0], [0.0]));
}
