use nelu3d_baselines::projector::measure_response::{BINS, curve, monotone};

#[test]
fn a_rising_sequence_is_the_nearest() {
    let mut knots: Vec<(f64, f64)> = [1.0, 3.0, 2.0, 4.0, 3.0, 2.0].iter().map(|l| (0.0, *l)).collect();
    monotone(&mut knots);
    assert_eq!(knots.iter().map(|k| k.1).collect::<Vec<_>>(), [1.0, 2.5, 2.5, 3.0, 3.0, 3.0]);
}

#[test]
fn a_power_comes_back() {
    let bins = (0..BINS)
        .map(|k| (0..100).map(|i| (k as f64 + (i as f64 + 0.5) / 100.0) / BINS as f64).map(|v| v.powf(1.2)).collect())
        .collect();
    // Light per value v^1.2 is light v^2.2.
    let r = curve(bins, Vec::new()).unwrap();
    assert!((r.gamma - 2.2).abs() < 0.05, "{}", r.gamma);
    for v in [0.1f32, 0.33, 0.5, 0.77, 0.95] {
        assert!((r.light_of(v) - v.powf(2.2)).abs() < 0.01, "{v}: {}", r.light_of(v));
    }
    assert_eq!((r.light_of(1.0), r.light_of(2.0)), (1.0, 1.0));
    assert!(curve(vec![Vec::new(); BINS], Vec::new()).is_none());
}
