use nalgebra::Vector3;
use nelu3d::calibrate::held_out::{Displacement, well_lit};
use nelu3d::calibrate::shared_displacement::Sample;

#[test]
fn a_displaced_board_is_told_from_noise() {
    // 0.3 mm in the middle, 5 mm more per unit of x/z, noise of 2 mm a sample, and some samples that are far off.
    let noise = |i: usize| 2.0 * (((i * 7919) % 1000) as f32 / 500.0 - 1.0);
    let samples: Vec<Sample> = (0..5000)
        .map(|i| {
            let plane = [f64::from(i % 71) / 350.0 - 0.1, f64::from(i % 53) / 260.0 - 0.1];
            let mm = if i % 50 == 0 { 900.0 } else { 0.3 + 5.0 * plane[0] as f32 + noise(i as usize) };
            let block = [i % 71 / 8, i % 53 / 8].map(|b| b as usize);
            Sample { g: 4.0 * mm, h: 4.0, plane, block }
        })
        .collect();
    let found = Displacement::of(0, &samples).unwrap();
    assert!((found.mm - 0.3).abs() < 0.05, "{}", found.mm);
    let error = found.plane - Vector3::new(0.3, 5.0, 0.0);
    assert!(error[0].abs() < 0.05 && error[1].abs() < 1.0 && error[2].abs() < 1.0, "{}", found.plane);
    assert!(Displacement::of(0, &samples[..10]).is_none());
}

#[test]
fn well_lit_follows_the_exposure_but_not_the_ink() {
    // A third ink of a twentieth of the paper's albedo; a few highlights; unusable pixels.
    let board = |paper: f32| -> Vec<f32> {
        let kinds = [paper, paper, 0.05 * paper, 0.0];
        let mut all: Vec<f32> = (0..4000).map(|i| kinds[i % 4]).collect();
        all[..20].fill(0.9);
        all
    };
    for paper in [0.8f32, 0.3, 0.08, 0.03] {
        let limit = well_lit(&board(paper));
        assert!(limit <= 0.1 && limit > 0.05 * paper && limit < paper, "{paper}: {limit}");
    }
    assert_eq!(well_lit(&board(0.8)), 0.1);
}
