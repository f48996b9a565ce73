use nelu3d_baselines::turbosl::blur::{Blur, HALF, sample, sample_backward, tap_gradient};

#[test]
fn keeps_place_and_brightness_and_differentiates() {
    let blur = Blur::of;
    let mut line = vec![0.0f32; 41];
    line[20] = 1.0;
    let free = [0.2, 0.1, 0.04, 0.0, 0.01, 0.1, 0.02, 0.03, 0.01, 0.0];
    let kernel = blur(free).taps();
    let out = blur(free).convolve(&line);
    let sum: f32 = out.iter().sum();
    let mean: f32 = out.iter().enumerate().map(|(i, v)| i as f32 * v).sum();
    assert!((sum - 1.0).abs() < 1e-6 && (mean - 20.0).abs() < 1e-5);
    // The two sides differ.
    assert!((kernel[HALF - 1] - 0.2).abs() < 1e-6 && (kernel[HALF + 1] - 0.2).abs() > 0.01, "{kernel:?}");
    assert_eq!(Blur::new().convolve(&line), line);
    // d of Σ s_i blurred_i by the free taps.
    let line: Vec<f32> = (0..41).map(|i| 0.5 + 0.7 * (i as f32 * 0.7).sin()).collect();
    let s: Vec<f32> = (0..41).map(|i| (i as f32 * 0.3).cos()).collect();
    let mut d = [0.0; 2 * HALF];
    blur(free).backward(&tap_gradient(&line, &s), &mut d);
    let value = |free: [f32; 2 * HALF]| -> f64 {
        blur(free).convolve(&line).iter().zip(&s).map(|(a, b)| f64::from(a * b)).sum()
    };
    for t in 0..2 * HALF {
        let at = |e: f32| {
            let mut free = free;
            free[t] += e;
            value(free)
        };
        let expected = (at(1e-3) - at(-1e-3)) / 2e-3;
        assert!((f64::from(d[t]) - expected).abs() < 0.02 * expected.abs().max(1.0), "{t}: {} {expected}", d[t]);
    }
}

#[test]
fn samples_between_pixels() {
    let line = [1.0, 3.0, 5.0];
    assert_eq!([sample(&line, 0.5), sample(&line, 2.0), sample(&line, -0.5), sample(&line, 7.0)], [2.0, 5.0, 0.5, 0.0]);
    let mut d = [0.0; 3];
    sample_backward(&mut d, 1.25, 4.0);
    sample_backward(&mut d, -3.0, 4.0);
    assert_eq!(d, [0.0, 3.0, 1.0]);
}
