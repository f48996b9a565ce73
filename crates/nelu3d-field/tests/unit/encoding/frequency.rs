use crate::check::{assert_gradient, uniform, uniform_f32};
use nelu3d_field::encoding::frequency::{Frequency, cpu, reference};

const ENCODING: Frequency = Frequency { n_frequencies: 20 };

#[test]
fn reference_gradient_matches_central_differences() {
    let encoding = Frequency { n_frequencies: 5 };
    let x: [f64; 3] = uniform(1, 3, 0.0, 1.0).try_into().unwrap();
    let d_out = uniform(2, encoding.n_features(3), -1.0, 1.0);
    let d_x = reference::backward(encoding, x, &d_out);
    assert_gradient(&x, &d_x, 1e-4, |x| {
        let mut out = vec![0.0; d_out.len()];
        reference::forward(encoding, <[f64; 3]>::try_from(x).unwrap(), &mut out);
        out.iter().zip(&d_out).map(|(a, b)| a * b).sum()
    });
}

#[test]
fn cpu_matches_the_reference_in_double_precision_up_to_the_highest_octave() {
    let n = ENCODING.n_features(3);
    let points: Vec<[f32; 3]> = uniform_f32(3, 300, -2.0, 2.0).chunks_exact(3).map(|x| x.try_into().unwrap()).collect();
    let d_out = uniform_f32(4, points.len() * n, -1.0, 1.0);
    let mut out = vec![0.0; points.len() * n];
    let mut d_points = vec![[0.0; 3]; points.len()];
    cpu::forward(ENCODING, &points, &mut out);
    cpu::backward(ENCODING, &points, &d_out, &mut d_points);
    // The reduction is exact, the polynomial good to two roundings.
    let tolerance = 3e-7;
    for (p, x) in points.iter().enumerate() {
        let x = x.map(|x| x as f64);
        let mut exact = vec![0.0; n];
        reference::forward(ENCODING, x, &mut exact);
        for (a, b) in out[p * n..].iter().zip(&exact) {
            assert!((*a as f64 - b).abs() < tolerance, "{a} against {b}");
        }
        let d_out: Vec<f64> = d_out[p * n..][..n].iter().map(|&d| d as f64).collect();
        let exact = reference::backward(ENCODING, x, &d_out);
        // Dominated by the highest octaves, 2^19 π.
        let scale = 2f64.powi(20) * std::f64::consts::PI;
        for a in 0..3 {
            assert!((d_points[p][a] as f64 - exact[a]).abs() < 4.0 * tolerance * scale);
        }
    }
}

#[test]
fn no_frequencies_no_features() {
    let none = Frequency { n_frequencies: 0 };
    cpu::forward(none, &[[0.5; 3]], &mut []);
    let mut d = [[1.0; 3]];
    cpu::backward(none, &[[0.5; 3]], &[], &mut d);
    assert_eq!(d, [[0.0; 3]]);
}
