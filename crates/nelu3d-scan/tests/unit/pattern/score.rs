use nelu3d_scan::pattern::{Codewords, ScoreOptions, confusion_matrix, score};

fn ramp(n: usize) -> Codewords {
    Codewords::new(1, (0..n).map(|u| u as f32 / (n - 1) as f32).collect())
}

#[test]
fn a_ramp_scores_what_theory_says() {
    let options = ScoreOptions { distances_px: vec![0, 4, 1000], sigma: 0.01, samples: 400, seed: 1 };
    let s = score(&ramp(201), &options);
    let near = |a: f64, b: f64| (a - b).abs() < 0.05 * b.abs() + 1e-6;
    assert!(near(s.sensitivity.median, 0.005) && near(s.sensitivity.min, 0.005) && near(s.sensitivity.sigma_px, 2.0));
    assert!(near(s.separations[0].euclidean, 0.005) && near(s.separations[1].euclidean, 0.025));
    assert_eq!((s.separations[0].within_noise, s.separations[2].within_noise), (1.0, 0.0));
    assert!(s.separations[2].euclidean.is_infinite());
    // The error is normal with σ = 2 px, rounded to columns; a little less at the ends.
    assert!(near(s.nearest.mean_px, 2.0 * (2.0 / std::f64::consts::PI).sqrt()), "{:?}", s.nearest);
    assert!(near(s.nearest.rms_px, (4.0_f64 + 1.0 / 12.0).sqrt()), "{:?}", s.nearest);
    assert!(near(s.nearest.beyond[1], 0.0244), "beyond 4.5 px, 2.25 σ: {:?}", s.nearest);
    assert_eq!((s.zncc, s.separations[0].zncc), (None, None));
    assert_eq!(score(&ramp(201), &options).nearest, s.nearest);
}

#[test]
fn equal_codewords_are_found() {
    let mut words = Codewords::new(3, (0..300).map(|i| ((i * 7919) % 300) as f32 / 300.0).collect());
    let copy = words.word(20).to_vec();
    words.data[3 * 70..3 * 71].copy_from_slice(&copy);
    let s = score(&words, &ScoreOptions { distances_px: vec![10, 60], samples: 2, ..ScoreOptions::default() });
    assert_eq!((s.separations[0].euclidean, s.separations[0].columns), (0.0, [20, 70]));
    assert!(s.separations[0].zncc.unwrap() < 1e-6 && s.separations[1].euclidean > 0.0);
}

#[test]
fn the_matrix_keeps_the_smallest_of_a_block() {
    let (side, all) = confusion_matrix(&ramp(10), 100);
    assert_eq!((side, all.len()), (10, 100));
    assert!((all[9] - 1.0).abs() < 1e-6 && all[11 * 3] == 0.0);
    let (side, few) = confusion_matrix(&ramp(10), 4);
    assert_eq!((side, few.len()), (4, 16));
    // Blocks 0..3 and 9..10: nearest are 2 and 9.
    assert!((few[3] - (7.0_f32 / 9.0).powi(2)).abs() < 1e-6);
}
