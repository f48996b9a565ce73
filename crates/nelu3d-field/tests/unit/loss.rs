use crate::check::{assert_close, assert_gradient, uniform, uniform_f32};
use nelu3d_field::loss::{MIN_OPACITY, Norms, cpu, reference};

/// Every scalar loss in both forms, as (name, reference, cpu, range of the first argument).
type Slow = fn(&[f64], &[f64], &mut [f64]) -> f64;
type Fast = fn(&[f32], &[f32], &mut [f32]) -> f64;
const LOSSES: [(&str, Slow, Fast, (f64, f64)); 5] = [
    (
        "lookup",
        |x, _, d| reference::lookup(Norms::default(), x, d),
        |x, _, d| cpu::lookup(Norms::default(), x, d),
        (-1.0, 1.0),
    ),
    (
        "pattern",
        |x, w, d| reference::pattern(Norms::default(), x, w, d),
        |x, w, d| cpu::pattern(Norms::default(), x, w, d),
        (-1.0, 1.0),
    ),
    ("mask", reference::mask, cpu::mask, (0.01, 0.99)),
    ("mask_log", reference::mask_log, cpu::mask_log, (-5.0, -0.01)),
    ("sparsity", |x, _, d| reference::sparsity(x, d), |x, _, d| cpu::sparsity(x, d), (-3.0, 3.0)),
];

#[test]
fn reference_gradients_match_central_differences() {
    for (_, slow, _, (lo, hi)) in LOSSES {
        let x = uniform(1, 50, lo, hi);
        let other = uniform(2, 50, 0.0, 1.0);
        let mut d = vec![0.0; 50];
        slow(&x, &other, &mut d);
        assert_gradient(&x, &d, 1e-5, |x| slow(x, &other, &mut [0.0; 50]));
    }
    let x = uniform(3, 60, -1.0, 1.0);
    let rows = |x: &[f64]| x.as_chunks::<3>().0.to_vec();
    let mut d = vec![[0.0; 3]; 20];
    reference::eikonal(&rows(&x), &mut d);
    assert_gradient(&x, d.as_flattened(), 1e-4, |x| reference::eikonal(&rows(x), &mut [[0.0; 3]; 20]));
}

#[test]
fn cpu_matches_reference() {
    // More than one task's share, so that the reduction tree is walked.
    for n in [0, 1, 10_001] {
        for (name, slow, fast, (lo, hi)) in LOSSES {
            let x = uniform_f32(1, n, lo, hi);
            let other = uniform_f32(2, n, 0.0, 1.0);
            let wide = |x: &[f32]| x.iter().map(|&x| x as f64).collect::<Vec<_>>();
            let (mut d, mut d_wide) = (vec![0.0; n], vec![0.0; n]);
            let expected = slow(&wide(&x), &wide(&other), &mut d_wide);
            let loss = fast(&x, &other, &mut d);
            // A few roundings of values of order 1.
            assert!((loss - expected).abs() <= 1e-6 * expected.max(1.0), "{name}: {loss} against {expected}");
            // Gradients without their 1/n, at most 100 (the mask loss at 0.01).
            let scaled: Vec<f32> = d.iter().map(|d| d * n as f32).collect();
            let expected: Vec<f32> = d_wide.iter().map(|d| (d * n as f64) as f32).collect();
            assert_close(&scaled, &expected, 8.0 * f32::EPSILON);
        }
        let x: Vec<[f32; 3]> = uniform_f32(3, 3 * n, -1.0, 1.0).as_chunks().0.to_vec();
        let wide: Vec<[f64; 3]> = x.iter().map(|x| x.map(|x| x as f64)).collect();
        let (mut d, mut d_wide) = (vec![[0.0; 3]; n], vec![[0.0; 3]; n]);
        let expected = reference::eikonal(&wide, &mut d_wide);
        let loss = cpu::eikonal(&x, &mut d);
        assert!((loss - expected).abs() <= 1e-6 * expected.max(1.0), "eikonal: {loss} against {expected}");
        let scaled: Vec<f32> = d.as_flattened().iter().map(|d| d * n as f32).collect();
        let expected: Vec<f32> = d_wide.as_flattened().iter().map(|d| (d * n as f64) as f32).collect();
        assert_close(&scaled, &expected, 16.0 * f32::EPSILON);
    }
}

#[test]
fn extremes_are_finite() {
    let mut d = [0.0f32; 3];
    // Blocked background is as wrong as it is opaque; nothing there at all has no gradient.
    let loss = cpu::mask_log(&[-1e4, -1e4, 0.0], &[0.0, 1.0, 1.0], &mut d);
    assert!((loss - (1e4 - MIN_OPACITY.ln()) / 3.0).abs() < 1e-2, "{loss}");
    assert_close(&d, &[-1.0 / 3.0, 0.0, 0.0], 1e-7);
    // The clamped form: finite, and without a gradient where it saturates.
    let loss = cpu::mask(&[0.0, 1.0, 0.5], &[1.0, 0.0, 1.0], &mut d);
    assert!(loss.is_finite() && d[0] == 0.0 && d[1] == 0.0 && d[2] < 0.0);
    let mut d = [[9.0f32; 3]];
    assert_eq!(cpu::eikonal(&[[0.0; 3]], &mut d), 1.0);
    assert_eq!(d, [[0.0; 3]]);
}
