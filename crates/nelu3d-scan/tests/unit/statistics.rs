use nelu3d_scan::statistics::{median, order_statistic, percentile};

#[test]
fn the_median_is_a_value_of_the_sample() {
    assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
    assert_eq!(median(&mut [4.0f32, 1.0, 3.0, 2.0]), Some(3.0));
    assert_eq!(median::<f64>(&mut []), None);
    assert_eq!(median(&mut [f64::NAN, 1.0, 2.0]), Some(2.0));
}

#[test]
fn order_statistics_are_those_of_the_sorted_values() {
    let values: Vec<f64> = (0..50).map(|i| f64::from((i * 37) % 50)).collect();
    for index in 0..50 {
        assert_eq!(order_statistic(&mut values.clone(), index), index as f64);
    }
}

#[test]
fn percentiles_are_those_of_numpy() {
    let values = [4.0, 1.0, 3.0, 2.0];
    assert_eq!(percentile(&mut values.clone(), 50.0), 2.5);
    assert_eq!(percentile(&mut values.clone(), 0.0), 1.0);
    assert_eq!(percentile(&mut values.clone(), 100.0), 4.0);
    assert!((percentile(&mut values.clone(), 95.0) - 3.85).abs() < 1e-12);
    assert!(percentile(&mut [], 50.0).is_nan());
}
