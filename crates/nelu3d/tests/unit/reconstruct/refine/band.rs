use nelu3d::reconstruct::refine::band::quadrature;

/// Moments of the logistic density that the NeuS weights sample, cut off at four widths, up to degree 5.
#[test]
fn three_samples_integrate_the_whole_band() {
    let density = |u: f64| (-u).exp() / (1.0 + (-u).exp()).powi(2);
    let moment = |power: i32| -> f64 {
        (0..80_000).map(|i| -4.0 + 8.0 * (f64::from(i) + 0.5) / 80_000.0).map(|u| density(u) * u.powi(power)).sum()
    };
    for power in 0..6 {
        let ours: f64 = quadrature().iter().map(|(u, w)| f64::from(*w) * f64::from(*u).powi(power)).sum();
        let expected = moment(power) / moment(0);
        assert!((ours - expected).abs() < 0.01 * expected.abs().max(1.0), "{power}: {ours} {expected}");
    }
}
