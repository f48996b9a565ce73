use std::f64::consts::TAU;

use nelu3d_scan::Image;
use nelu3d_scan::pattern::{
    Alacarte, Axis, Codewords, Mps, Pattern, PhaseShift, ScoreOptions, SplitMix, expected_zncc_error, score,
};

use super::images;

fn zncc_errors(images: &[Image], sigma: f64) -> Vec<f64> {
    let words = Codewords::of_images(images, Axis::X);
    let options = ScoreOptions { distances_px: vec![2, 10], sigma, samples: 8, seed: 4 };
    score(&words, &options).zncc.unwrap().beyond
}

#[test]
fn fewer_errors_than_sinusoids_under_the_same_cap() {
    let (n, cap, sigma) = (640, 8.0, 0.02);
    let p = Alacarte { count: 4, max_frequency: cap, iterations: 400, ..Alacarte::default() };
    let ours = zncc_errors(&images(Pattern::Alacarte(p), n, 1).unwrap(), sigma);
    // Four images: one period in four steps, from the slowest to the cap, or two frequencies as micro phase
    // shifting.
    let mut best = f64::INFINITY;
    for cycles in [1.0, 2.0, 4.0, 8.0] {
        let sine = PhaseShift { axis: Axis::X, periods_px: vec![n as f64 * 0.99 / cycles], steps: vec![4] };
        best = best.min(zncc_errors(&images(Pattern::Phase(sine), n, 1).unwrap(), sigma)[0]);
    }
    assert!(ours[0] < 0.5 * best, "{ours:?}, sinusoids {best}");
    let micro = Mps { frequencies: 2, mean_period_px: 120.0, band: 0.33, ..Mps::default() };
    let micro = zncc_errors(&images(Pattern::Mps(micro), n, 1).unwrap(), sigma)[0];
    assert!(ours[0] < micro, "{ours:?}, micro phase shifting {micro}");
}

#[test]
fn a_seed_decides_and_the_cap_holds() {
    let p = Alacarte { count: 3, max_frequency: 6.0, iterations: 30, ..Alacarte::default() };
    let made = images(Pattern::Alacarte(p.clone()), 300, 2).unwrap();
    assert_eq!(made, images(Pattern::Alacarte(p.clone()), 300, 2).unwrap());
    assert_ne!(made, images(Pattern::Alacarte(Alacarte { seed: 1, ..p.clone() }), 300, 2).unwrap());
    for image in &made {
        let line = &image.data[..300];
        assert!(line.contains(&0.0) && line.contains(&1.0));
        // A second difference is at most (2π·6/300)² / 4 of each wave's amplitude times two.
        let bend = line.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs()).fold(0.0, f32::max);
        assert!(bend < 0.02, "{bend}");
    }
    // Many columns take no longer: optimized on fewer.
    let short = Alacarte { iterations: 1, ..p };
    assert_eq!(images(Pattern::Alacarte(short), 5000, 1).unwrap()[0].data.len(), 5000);
}

/// Patterns of all waves up to so many cycles, each of random amplitude, stretched to [0, 1].
fn random_waves(n: usize, count: usize, max_frequency: usize, random: &mut SplitMix) -> Vec<Vec<f64>> {
    let mut line = || {
        let waves: Vec<[f64; 3]> = (1..=max_frequency).map(|f| [f as f64, random.normal(), random.normal()]).collect();
        let at = |u: usize| {
            let phase = |f: f64| TAU * f * u as f64 / n as f64;
            waves.iter().map(|&[f, a, b]| a * phase(f).cos() + b * phase(f).sin()).sum::<f64>()
        };
        let line: Vec<f64> = (0..n).map(at).collect();
        let (min, max) = line.iter().fold((f64::MAX, f64::MIN), |(a, b), &v| (a.min(v), b.max(v)));
        line.iter().map(|v| (v - min) / (max - min)).collect()
    };
    (0..count).map(|_| line()).collect()
}

/// Central differences of the soft error in the words, the noise held.
#[test]
fn the_gradient_is_that_of_the_expected_error() {
    let (n, count) = (40, 3);
    let waves = random_waves(n, count, 4, &mut SplitMix(2));
    for reach in [0, 1] {
        let at = |lines: &[Vec<f64>]| expected_zncc_error(lines, reach, 0.02, 1, 40.0, 9);
        let (_, gradient) = at(&waves);
        for (j, u) in [(0, 3), (1, 0), (2, 17), (0, 39)] {
            let h = 2e-3;
            let moved = |by: f64| {
                let mut lines = waves.clone();
                lines[j][u] += by;
                at(&lines).0
            };
            let difference = (moved(h) - moved(-h)) / (2.0 * h);
            let got = gradient[u * count + j];
            assert!((difference - got).abs() < 0.02 * got.abs() + 2e-4, "{j}, {u}: {got}, not {difference}");
        }
    }
}

#[test]
fn impossible_settings_are_refused() {
    let good = Alacarte { iterations: 1, ..Alacarte::default() };
    for p in [
        Alacarte { count: 2, ..good.clone() },
        Alacarte { max_frequency: f64::NAN, ..good.clone() },
        Alacarte { max_frequency: 50.0, ..good.clone() },
        Alacarte { neighbors: 17, ..good.clone() },
        Alacarte { noise: 0.0, ..good.clone() },
        Alacarte { iterations: 1_000_000, ..good },
    ] {
        assert!(images(Pattern::Alacarte(p.clone()), 64, 2).is_err(), "{p:?}");
    }
}
