use std::f64::consts::TAU;

use nelu3d_scan::pattern::{Axis, Pattern, Random};

use super::images;

#[test]
fn its_power_lies_in_its_band() {
    let n = 1600;
    let pattern = Random { axis: Axis::X, min_period_px: 20.0, max_period_px: 80.0, seed: 5 };
    let line = images(Pattern::Random(pattern), n, 1).unwrap().remove(0).data;
    let mean = line.iter().sum::<f32>() as f64 / n as f64;
    // The power at k cycles per image, under a window that keeps a wave between two bins from leaking far.
    let power = |k: usize| {
        let (mut c, mut s) = (0.0, 0.0);
        for (u, &v) in line.iter().enumerate() {
            let window = 0.5 - 0.5 * (TAU * u as f64 / n as f64).cos();
            let a = TAU * (k * u) as f64 / n as f64;
            c += (f64::from(v) - mean) * window * a.cos();
            s += (f64::from(v) - mean) * window * a.sin();
        }
        c * c + s * s
    };
    let all: f64 = (1..n / 2).map(power).sum();
    let inside: f64 = (n / 80 - 3..=n / 20 + 3).map(power).sum();
    assert!(inside > 0.999 * all, "{inside} of {all}");
    let other = images(Pattern::Random(Random { seed: 6, ..pattern }), n, 1).unwrap().remove(0).data;
    assert_ne!(line, other);
}

#[test]
fn impossible_bands_are_refused() {
    for (min_period_px, max_period_px) in [(1.0, 8.0), (9.0, 8.0), (8.0, f64::NAN)] {
        let random = Random { axis: Axis::X, min_period_px, max_period_px, seed: 0 };
        assert!(images(Pattern::Random(random), 8, 8).is_err());
    }
}
