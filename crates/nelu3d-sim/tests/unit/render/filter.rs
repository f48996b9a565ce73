use nelu3d_sim::render::PixelFilter;

#[test]
fn it_keeps_sums_and_has_the_variance_of_pixel_and_blur() {
    for (n, sigma) in [(1, 0.0), (4, 0.0), (4, 0.4), (3, 1.2), (16, 0.3)] {
        let filter = PixelFilter::new(n, sigma);
        let radius = filter.radius() as i64;
        let taps: Vec<f64> = (-radius..n as i64 + radius).map(|i| f64::from(filter.weight(i))).collect();
        let at = |i: usize| (i as f64 - radius as f64 + 0.5) / n as f64;
        let total: f64 = taps.iter().sum();
        let mean: f64 = taps.iter().enumerate().map(|(i, t)| t * at(i)).sum();
        let variance: f64 = taps.iter().enumerate().map(|(i, t)| t * (at(i) - 0.5).powi(2)).sum();
        assert!((total - 1.0).abs() < 1e-6 && (mean - 0.5).abs() < 1e-6, "{n}, {sigma}: {total}, {mean}");
        // A box of n samples: (n² − 1) / 12 in units of a sample.
        let expected = (n * n - 1) as f64 / 12.0 / (n * n) as f64 + sigma * sigma;
        assert!((variance - expected).abs() < 0.01 * expected + 1e-9, "{n}, {sigma}: {variance}, not {expected}");
    }
}
