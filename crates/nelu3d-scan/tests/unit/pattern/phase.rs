use std::f64::consts::TAU;

use nelu3d_scan::pattern::{Axis, Pattern, PhaseDecoder, PhaseShift, SplitMix, Wave};

use super::images;

/// Worst and root mean square error over all columns of what a camera with this noise makes of the images.
fn errors(pattern: &PhaseShift, n: usize, sigma: f64) -> (f64, f64) {
    let decoder = PhaseDecoder::new(&pattern.waves(n).unwrap(), n).unwrap();
    let (w, h) = if pattern.axis == Axis::X { (n, 1) } else { (1, n) };
    let images = images(Pattern::Phase(pattern.clone()), w, h).unwrap();
    let mut random = SplitMix(3);
    let (mut worst, mut squares): (f64, f64) = (0.0, 0.0);
    for u in 0..n {
        let values: Vec<f32> = images
            .iter()
            .map(|i| {
                let shown = (f64::from(i.data[u]) * 255.0).round() / 255.0;
                (0.6 * shown + 0.2 + sigma * random.normal()) as f32
            })
            .collect();
        let got = decoder.decode(&values, sigma as f32).unwrap();
        let error = f64::from(got.column) - u as f64;
        worst = worst.max(error.abs());
        squares += error * error;
    }
    (worst, (squares / n as f64).sqrt())
}

fn pattern(axis: Axis, periods_px: &[f64], steps: &[usize]) -> PhaseShift {
    PhaseShift { axis, periods_px: periods_px.into(), steps: steps.into() }
}

#[test]
fn columns_come_back_with_their_fractions() {
    for n in [8, 20, 21, 800, 1280, 1920] {
        let (worst, _) = errors(&pattern(Axis::X, &[], &[]), n, 0.0);
        assert!(worst < 0.05, "{n} columns: {worst} px, by 8-bit codes alone");
    }
    for (periods, steps) in [
        (vec![1500.0], vec![3]),
        // Beats: 59 · 60 and 1 / (1/59 − 2/60 + 1/61) periods are longer than the image.
        (vec![59.0, 60.0, 61.0], vec![4]),
        // Unambiguous over the least common multiple, 10,800 px.
        (vec![16.0, 27.0, 25.0], vec![3, 4, 5]),
        (vec![160.0, 20.0, 1290.0], vec![8]),
    ] {
        let (worst, _) = errors(&pattern(Axis::Y, &periods, &steps), 1280, 0.0);
        let finest = periods.iter().copied().fold(f64::MAX, f64::min);
        assert!(worst < 1e-3 * finest, "{periods:?}: {worst} px");
    }
}

/// The variance of a phase from N steps is 2σ² / (N A²) rad² (e.g. Surrel 1996), which the finest period turns to
/// px.
#[test]
fn noise_costs_what_theory_says() {
    let sigma = 0.01;
    for steps in [3, 4, 8] {
        let (worst, rms) = errors(&pattern(Axis::X, &[20.0, 160.0, 1280.0], &[steps]), 1280, sigma);
        let expected = 20.0 / TAU * (2.0 / steps as f64).sqrt() * sigma / 0.3;
        assert!((0.9..1.15).contains(&(rms / expected)) && worst < 5.0 * expected, "{steps}: {rms}, {worst}");
    }
}

#[test]
fn an_ambiguous_pixel_says_so() {
    let one = pattern(Axis::X, &[32.0], &[4]);
    let decoder = PhaseDecoder::new(&one.waves(640).unwrap(), 640).unwrap();
    let values: Vec<f32> = images(Pattern::Phase(one), 640, 1).unwrap().iter().map(|i| i.data[100]).collect();
    let got = decoder.decode(&values, 0.0).unwrap();
    assert!((got.column.rem_euclid(32.0) - 100.0_f32.rem_euclid(32.0)).abs() < 1e-3, "{got:?}");
    assert!(got.runner_up < 1e-3 && !got.is_reliable(), "{got:?}");
    assert_eq!(decoder.decode(&[f32::NAN; 4], 0.0), None);
    assert_eq!(decoder.decode(&[0.4; 4], 0.0), None);
}

#[test]
fn impossible_settings_are_refused() {
    for (periods, steps) in
        [(vec![1.0], vec![4]), (vec![20.0], vec![2]), (vec![20.0, 30.0], vec![3, 3, 3]), (vec![f64::NAN], vec![4])]
    {
        assert!(images(Pattern::Phase(pattern(Axis::X, &periods, &steps)), 64, 4).is_err());
    }
    let wave = |shift| Wave { period_px: 20.0, shift };
    assert!(PhaseDecoder::new(&[], 64).is_err());
    assert!(PhaseDecoder::new(&[wave(0.0), wave(0.5)], 64).is_err());
    assert!(PhaseDecoder::new(&[wave(0.0), wave(0.5), wave(1.0)], 64).is_err());
}
