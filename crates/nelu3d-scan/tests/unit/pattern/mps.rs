use std::f64::consts::TAU;

use nelu3d_scan::pattern::{Mps, MpsDecoder, Pattern, SplitMix, Wave};

use super::images;

/// Decoded columns minus true ones, of a camera with gain, offset and noise that sees 8-bit images.
fn errors(pattern: &Mps, n: usize, sigma: f64) -> Vec<f64> {
    let decoder = MpsDecoder::new(&pattern.waves(n).unwrap(), n).unwrap();
    let images = images(Pattern::Mps(pattern.clone()), n, 1).unwrap();
    assert_eq!(images.len(), pattern.waves(n).unwrap().len());
    let mut random = SplitMix(5);
    (0..n)
        .map(|u| {
            let values: Vec<f32> = images
                .iter()
                .map(|i| {
                    let shown = (f64::from(i.data[u]) * 255.0).round() / 255.0;
                    (0.7 * shown + 0.1 + sigma * random.normal()) as f32
                })
                .collect();
            f64::from(decoder.decode(&values, sigma as f32).unwrap().column) - u as f64
        })
        .collect()
}

#[test]
fn columns_come_back_with_their_fractions() {
    for (mean_period_px, frequencies, n) in [(16.0, 5, 640), (64.0, 5, 1280), (32.0, 6, 800)] {
        let pattern = Mps { mean_period_px, frequencies, ..Mps::default() };
        let worst = errors(&pattern, n, 0.0).iter().fold(0.0_f64, |a, e| a.max(e.abs()));
        assert!(worst < 0.3 * mean_period_px / 16.0, "{frequencies} about {mean_period_px} px: {worst}");
    }
}

#[test]
fn noise_moves_columns_a_little() {
    let e = errors(&Mps::default(), 1280, 0.01);
    let rms = (e.iter().map(|e| e * e).sum::<f64>() / 1280.0).sqrt();
    // The first phase's own, from three steps.
    let expected = 16.0 / TAU * (2.0_f64 / 3.0).sqrt() * 0.01 / 0.35;
    assert!((0.8..1.2).contains(&(rms / expected)), "{rms} px, not {expected}");
}

#[test]
fn images_are_two_more_than_frequencies_and_lie_in_the_band() {
    let pattern = Mps { frequencies: 4, mean_period_px: 64.0, band: 0.05, ..Mps::default() };
    let waves = pattern.waves(1024).unwrap();
    assert_eq!(waves.len(), 6);
    assert!(waves.iter().all(|w| (60.8..=67.2).contains(&w.period_px)), "{waves:?}");
    assert_eq!(waves, pattern.resolved(1024).unwrap().waves(1024).unwrap());
}

/// The smallest squared distance in (cos φ₂, …, cos φ_F) of two columns of `n` whose first phases are nearly equal.
fn smallest_distance(periods_px: &[f64], n: usize) -> f64 {
    let squared = |u: usize, v: usize| {
        periods_px[1..].iter().map(|p| ((TAU * u as f64 / p).cos() - (TAU * v as f64 / p).cos()).powi(2)).sum::<f64>()
    };
    let shifts = (1..).map(|order| f64::from(order) * periods_px[0]).take_while(|shift| shift.ceil() < n as f64);
    shifts
        .flat_map(|shift| [shift.floor() as usize, shift.ceil() as usize])
        .flat_map(|shift| (shift..n).map(move |v| (v - shift, v)))
        .map(|(u, v)| squared(u, v))
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn chosen_periods_beat_an_even_spread() {
    let chosen: Vec<f64> = Mps::default().waves(1280).unwrap()[2..].iter().map(|w| w.period_px).collect();
    let even: Vec<f64> = (0..5).map(|i| 14.4 + 0.8 * f64::from(i)).collect();
    let score = |p: &[f64]| smallest_distance(p, 1280);
    assert!(score(&chosen) > 2.0 * score(&even), "{} and {}", score(&chosen), score(&even));
}

#[test]
fn other_sets_are_refused() {
    let wave = |period_px, shift| Wave { period_px, shift };
    for waves in [
        vec![],
        vec![wave(16.0, 0.0), wave(16.0, 0.3), wave(16.0, 0.6)],
        vec![wave(16.0, 0.0), wave(16.0, 0.3), wave(15.0, 0.0)],
        vec![wave(16.0, 0.0), wave(16.0, 0.0), wave(16.0, 1.0), wave(15.0, 0.0)],
    ] {
        assert!(MpsDecoder::new(&waves, 640).is_err(), "{waves:?}");
    }
    for pattern in [
        Mps { frequencies: 1, ..Mps::default() },
        Mps { mean_period_px: f64::NAN, ..Mps::default() },
        Mps { band: 0.9, ..Mps::default() },
        Mps { periods_px: vec![16.0], ..Mps::default() },
        Mps { periods_px: vec![16.0, 1.0], ..Mps::default() },
    ] {
        assert!(images(Pattern::Mps(pattern.clone()), 64, 2).is_err(), "{pattern:?}");
    }
}
