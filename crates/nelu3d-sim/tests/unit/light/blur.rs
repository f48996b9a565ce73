use std::f64::consts::TAU;

use nelu3d_scan::Image;
use nelu3d_sim::light::blur::{BlurStack, b_spline, sampled_gaussian};

/// A Gaussian of standard deviation s leaves exp(−½ (2π s / period)²) of a sinusoid's amplitude.
#[test]
fn a_sinusoid_loses_the_amplitude_its_blur_says() {
    let period = 24.0;
    let wave = |u: f64| (TAU * u / period).cos();
    let image = |value: &dyn Fn(usize) -> f64| {
        let data = (0..400 * 9).map(|i| value(i % 400) as f32).collect();
        Image { width: 400, height: 9, channels: 1, data }
    };
    // Rows blur into the dark outside: white, blurred alike, tells how much. Within a hundredth, because a mixture
    // of two Gaussians of the right variance is nearly, not quite, a Gaussian.
    let stack = BlurStack::new(&[image(&|i| wave(i as f64)), image(&|_| 1.0)]);
    for sigma in [0.5, 0.8, 1.3, 2.0, 4.0] {
        let expected = (-0.5 * (TAU * sigma / period).powi(2)).exp();
        for u in [150.0, 152.4, 160.7, 169.1] {
            let mut got = [0.0; 2];
            stack.at([u, 4.0], sigma, &mut got);
            let got = f64::from(got[0] / got[1]);
            assert!((got - expected * wave(u)).abs() < 0.01, "{sigma} at {u}: {got}, {}", expected * wave(u));
        }
    }
}

#[test]
fn sampled_gaussians_have_their_variance() {
    for sigma in [0.4, 0.5, 1.0, 7.0, 54.0] {
        let half = sampled_gaussian(sigma * sigma, (4.0f64 * sigma).ceil() as usize + 1);
        let total = 2.0 * half.iter().sum::<f64>() - half[0];
        let variance = 2.0 * half.iter().enumerate().map(|(n, v)| (n * n) as f64 * v).sum::<f64>();
        assert!((total - 1.0).abs() < 1e-9 && (variance / (sigma * sigma) - 1.0).abs() < 1e-9, "{total}, {variance}");
    }
    let taps = b_spline(0.3);
    assert!((taps.iter().sum::<f32>() - 1.0).abs() < 1e-6 && (taps[2] - taps[0] - 0.3).abs() < 1e-6);
}

#[test]
fn a_point_spreads_evenly_and_keeps_its_light() {
    let mut image = Image::new(41, 31, 1);
    image.data[15 * 41 + 20] = 1.0;
    let stack = BlurStack::new(&[image]);
    let value = |x: f64, y: f64| {
        let mut out = [0.0];
        stack.at([x, y], 2.0, &mut out);
        f64::from(out[0])
    };
    let mut moments = [0.0; 4];
    for (x, y) in (0..41 * 31).map(|i| (f64::from(i % 41), f64::from(i / 41))) {
        let v = value(x, y);
        let (dx, dy) = (x - 20.0, y - 15.0);
        [v, v * dx + v * dy, v * dx * dx, v * dy * dy].iter().zip(&mut moments).for_each(|(a, m)| *m += a);
    }
    assert!((moments[0] - 1.0).abs() < 1e-4 && moments[1].abs() < 1e-4, "{moments:?}");
    assert!((moments[2] - 4.0).abs() < 0.004 && (moments[3] - 4.0).abs() < 0.004, "{moments:?}");
}

#[test]
fn outside_is_dark() {
    let stack = BlurStack::new(&[Image { width: 4, height: 4, channels: 3, data: vec![1.0; 48] }]);
    for (u, v, expected) in [(-1.5, 1.0, 0.0), (f64::NAN, 1.0, 0.0), (4.5, 1.0, 0.0), (1.5, 1.0, 1.0), (3.5, 2.0, 0.5)]
    {
        let mut out = [7.0; 3];
        stack.at([u, v], 0.1, &mut out);
        assert_eq!(out, [expected; 3], "{u}, {v}");
    }
}
