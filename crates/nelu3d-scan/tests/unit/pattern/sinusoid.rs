use std::f64::consts::TAU;

use nelu3d_scan::pattern::{Axis, Pattern, Sinusoid};

use super::images;

/// N-step phase shifting: phase = atan2(Σ I sin, Σ I cos).
#[test]
fn the_phase_comes_back_from_the_steps() {
    for steps in [3, 4, 5] {
        let pattern = Sinusoid { axis: Axis::X, period_px: 17.3, steps };
        let images = images(Pattern::Sinusoid(pattern), 100, 2).unwrap();
        for u in 0..100 {
            let (mut s, mut c) = (0.0, 0.0);
            for (i, image) in images.iter().enumerate() {
                let shift = TAU * i as f64 / steps as f64;
                s += f64::from(image.pixel(u, 1)[0]) * shift.sin();
                c += f64::from(image.pixel(u, 1)[0]) * shift.cos();
            }
            let got = s.atan2(c).rem_euclid(TAU);
            let expected = (TAU * u as f64 / 17.3).rem_euclid(TAU);
            let error = (got - expected + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
            assert!(error.abs() < 1e-5, "{steps} steps, column {u}: {got} instead of {expected}");
        }
    }
}

#[test]
fn impossible_settings_are_refused() {
    for (period_px, steps) in [(1.0, 1), (f64::NAN, 1), (f64::INFINITY, 1), (8.0, 0), (8.0, 65)] {
        assert!(images(Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps }), 8, 8).is_err());
    }
}
