use nelu3d_scan::camera::Distortion;

#[test]
fn undistort_inverts_distort() {
    let lists: [&[f64]; 6] = [
        &[],
        &[-0.1, 0.05, 1e-3, -2e-3],
        &[-0.081, 0.062, 0.0006, -0.0009, 0.01],
        &[-0.2, 0.1, 1e-3, 1e-3, 0.02, 0.01, -0.02, 0.01],
        &[-0.2, 0.1, 1e-3, 1e-3, 0.02, 0.01, -0.02, 0.01, 1e-3, -2e-3, 1e-3, 1e-3],
        &[-0.2, 0.1, 1e-3, 1e-3, 0.02, 0.01, -0.02, 0.01, 1e-3, -2e-3, 1e-3, 1e-3, 0.02, -0.03],
    ];
    for coeffs in lists {
        let d = Distortion::new(coeffs).unwrap();
        for i in -4..=4 {
            for j in -4..=4 {
                let p = [i as f64 * 0.08, j as f64 * 0.07];
                let q = d.undistort(d.distort(p));
                assert!((p[0] - q[0]).abs() < 1e-11 && (p[1] - q[1]).abs() < 1e-11, "{coeffs:?} at {p:?}");
                let (j, h) = (d.jacobian(p), 1e-6);
                for (axis, step) in [[h, 0.0], [0.0, h]].into_iter().enumerate() {
                    let [after, before] = [1.0, -1.0].map(|s| d.distort([p[0] + s * step[0], p[1] + s * step[1]]));
                    for k in 0..2 {
                        let slope = (after[k] - before[k]) / (2.0 * h);
                        assert!((j[(k, axis)] - slope).abs() < 1e-8, "{coeffs:?} at {p:?}: {j}, {slope}");
                    }
                }
            }
        }
    }
}

#[test]
fn other_counts_and_nan_are_refused() {
    assert!(Distortion::new(&[0.1]).is_none());
    assert!(Distortion::new(&[0.1, f64::NAN, 0.0, 0.0]).is_none());
}
