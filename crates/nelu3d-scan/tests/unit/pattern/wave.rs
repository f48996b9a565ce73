use nelu3d_scan::pattern::Wave;

#[test]
fn waves_are_found_in_8_bit_lines() {
    for (period_px, shift, n) in
        [(16.3, 0.7, 1280), (64.0, 0.0, 800), (900.0, 0.25, 1280), (1280.0, 0.5, 1280), (2.7, 0.1, 333)]
    {
        let wave = Wave { period_px, shift };
        let line: Vec<f32> =
            (0..n).map(|u| ((0.1 + 0.8 * wave.value(u as f64)) * 255.0).round() as f32 / 255.0).collect();
        let got = Wave::fit(&line).unwrap();
        let turned = (got.wave.shift - shift + 0.5).rem_euclid(1.0) - 0.5;
        // In px at the far end of the line.
        let drift = n as f64 * (got.wave.period_px / period_px - 1.0);
        assert!(drift.abs() < 0.03 * period_px && turned.abs() < 0.01, "{wave:?}: {got:?}");
        assert!((got.amplitude - 0.4).abs() < 0.01 && (got.offset - 0.5).abs() < 0.01 && got.rms < 0.003, "{got:?}");
    }
}

#[test]
fn other_lines_are_told_by_their_misfit() {
    let ramp: Vec<f32> = (0..500).map(|u| u as f32 / 499.0).collect();
    assert!(Wave::fit(&ramp).is_none_or(|f| f.rms > 0.01 || f.amplitude > 0.7));
    let square: Vec<f32> = (0..500).map(|u| (u / 8 % 2) as f32).collect();
    assert!(Wave::fit(&square).is_none_or(|f| f.rms > 0.1));
    assert_eq!(Wave::fit(&[0.5; 100]), None);
    assert_eq!(Wave::fit(&[f32::NAN; 100]), None);
    assert_eq!(Wave::fit(&[0.0, 1.0]), None);
}
