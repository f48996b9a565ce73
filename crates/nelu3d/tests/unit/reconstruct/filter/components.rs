use nelu3d::reconstruct::FilterSettings;
use nelu3d::reconstruct::filter::components::reject_unexplained_components;
use nelu3d::reconstruct::filter::judgement::Alternatives;
use nelu3d::reconstruct::refine::Refined;
use nelu3d::surface::PixelStatus;
use nelu3d_scan::Camera;

/// Whether two flat pieces, `first` and 20 pixels wide and 20 high, at different depths, are kept.
fn kept(first: usize, chi2: [f32; 2], unseen: [f32; 2], chance: Option<f32>) -> [bool; 2] {
    kept_where(false, first, chi2, unseen, chance)
}

/// Whether two flat pieces (as in [`kept`]) are kept where the noise is known, or where it is not.
fn kept_where(noise_is_known: bool, first: usize, chi2: [f32; 2], unseen: [f32; 2], chance: Option<f32>) -> [bool; 2] {
    statuses(noise_is_known, first, chi2, unseen, chance, [0.0; 2]).map(|s| s == PixelStatus::Valid)
}

/// The status of the two pieces, of which a fraction `beyond` of the pixels is explained outside the volume.
fn statuses(
    noise_is_known: bool,
    first: usize,
    chi2: [f32; 2],
    unseen: [f32; 2],
    chance: Option<f32>,
    beyond: [f32; 2],
) -> [PixelStatus; 2] {
    let camera = Camera::pinhole(50, 20, 500.0, 500.0, 25.0, 10.0);
    let n = camera.n_pixels();
    let piece = |i: usize| match i % 50 {
        x if x < first => Some(0),
        30.. => Some(1),
        _ => None,
    };
    let mut depth: Vec<f32> = (0..n).map(|i| piece(i).map_or(f32::NAN, |p| [700.0, 600.0][p])).collect();
    let mut refined = Refined::empty(n, Vec::new(), Vec::new());
    for i in 0..n {
        let Some(p) = piece(i) else { continue };
        (refined.chi2[i], refined.unseen[i]) = (chi2[p], unseen[p]);
    }
    let mut status = vec![PixelStatus::Valid; n];
    let settings = FilterSettings::default();
    let alternatives = |pixels: &[usize]| {
        let piece = piece(pixels[0]).expect("components consist of pieces");
        Alternatives {
            by_chance: chance,
            foreign_chi2: if chance == Some(0.0) { 1.8 } else { 1.0 },
            beyond: beyond[piece],
        }
    };
    let explained = (&refined, &vec![0.5; n][..]);
    reject_unexplained_components(
        &mut depth,
        &mut status,
        &camera,
        explained,
        &settings,
        noise_is_known,
        (alternatives, |_| false),
    );
    for i in 0..n {
        assert_eq!(depth[i].is_finite(), piece(i).is_some() && status[i] == PixelStatus::Valid);
    }
    [status[0], status[49]]
}

#[test]
fn light_of_unseen_origin_may_not_buy_a_wrong_period() {
    assert_eq!(kept(20, [0.6, 1.7], [0.0, 0.05], None), [true, true]);
    // Neither χ² 2.5 nor a tenth of unseen light is too much alone.
    assert_eq!(kept(20, [2.5, 0.7], [0.0, 0.09], None), [true, true]);
    assert_eq!(kept(20, [0.7, 2.5], [0.0, 0.1], None), [true, false]);
    assert_eq!(kept(20, [0.6, 0.5], [0.0, 0.3], None), [true, false]);
}

#[test]
fn what_chance_does_not_explain_may_have_more_light_of_unseen_origin() {
    assert_eq!(kept(20, [1.9, 0.5], [0.15, 0.0], Some(0.0)), [true, true]);
    assert_eq!(kept(20, [0.7, 2.5], [0.0, 0.24], Some(0.08)), [true, false]);
    // A codeword as good as that has half of all that do not belong there.
    assert_eq!(kept(20, [0.3, 0.3], [0.0, 0.0], Some(0.3)), [true, true]);
    assert_eq!(kept(20, [0.3, 0.3], [0.0, 0.0], Some(0.55)), [false, false]);
}

#[test]
fn what_fits_within_known_noise_need_not_differ_from_chance() {
    // A real scan under three a la carte patterns: every codeword has some depth on every ray.
    assert_eq!(kept_where(true, 20, [1.06, 0.91], [0.0, 0.01], Some(0.6)), [true, true]);
    assert_eq!(kept_where(false, 20, [1.06, 0.91], [0.0, 0.01], Some(0.6)), [false, false]);
    // What wrong pieces had at best.
    assert_eq!(kept_where(true, 20, [1.06, 2.8], [0.0, 0.0], Some(0.6)), [true, false]);
    assert_eq!(kept_where(true, 20, [1.06, 0.9], [0.0, 0.09], Some(0.6)), [true, false]);
}

#[test]
fn what_is_explained_among_nothing_else_is_chance() {
    assert_eq!(kept(20, [2.8, 9.0], [0.0, 0.3], None), [true, false]);
    assert_eq!(kept(3, [2.8, 9.0], [0.0, 0.3], None), [false, false]);
    assert_eq!(kept(3, [1.0, 9.0], [0.0, 0.3], None), [true, false]);
}

#[test]
fn a_wrong_period_fits_much_worse_than_the_rest_of_the_scene() {
    // Three boards by hand under 2 × 3 phases, sine + triangle + random; then a right piece of a real scene.
    assert_eq!(kept(28, [0.57, 3.03], [0.009, 0.001], Some(0.03)), [true, false]);
    assert_eq!(kept(28, [0.38, 2.17], [0.006, 0.048], Some(0.03)), [true, false]);
    assert_eq!(kept(28, [1.08, 3.52], [0.04, 0.0], Some(0.06)), [true, true]);
    // What is within the noise is right however good the rest is, and the larger piece tells what is typical.
    assert_eq!(kept(28, [0.1, 1.7], [0.0, 0.0], Some(0.0)), [true, true]);
    assert_eq!(kept(3, [3.0, 0.5], [0.0, 0.0], Some(0.01)), [false, true]);
}

#[test]
fn what_no_foreign_codeword_does_may_fit_a_little_worse_than_the_rest() {
    // A box under Gray code before a wall that fits better than noise allows.
    assert_eq!(kept(28, [0.47, 2.28], [0.017, 0.03], Some(0.0)), [true, true]);
    assert_eq!(kept(28, [0.47, 2.28], [0.017, 0.03], Some(0.01)), [true, false]);
    // A wrong period of four chessboards by hand under 2 × 3 phases.
    assert_eq!(kept(28, [0.8, 6.12], [0.04, 0.07], Some(0.0)), [true, false]);
    // Whatever chance does, a codeword that hardly fits is at a wrong depth.
    assert_eq!(kept(28, [0.47, 9.0], [0.017, 0.0], Some(0.0)), [true, false]);
}

#[test]
fn what_a_point_outside_the_volume_explains_better_lies_there() {
    use PixelStatus::{OutsideVolume, Valid};
    let beyond = |beyond| statuses(false, 20, [3.5, 1.5], [0.09, 0.0], Some(0.07), beyond);
    assert_eq!(beyond([0.52, 0.0]), [OutsideVolume, Valid]);
    assert_eq!(beyond([0.2, 0.0]), [Valid, Valid]);
}

#[test]
fn what_chance_explains_that_often_has_to_fit_as_noise_does() {
    // Chance explains a fifth of codewords, and of a piece twice as large nothing is explained: two thirds of a piece.
    let beside_unexplained = |chi2: f32, unseen: f32| kept_where(true, 28, [15.0, chi2], [0.4, unseen], Some(0.2))[1];
    assert!(beside_unexplained(0.9, 0.005));
    assert!(!beside_unexplained(1.0, 0.03));
    assert!(!beside_unexplained(1.7, 0.0));
    // Where nothing else is unexplained it may.
    assert_eq!(kept_where(true, 28, [0.5, 1.7], [0.0, 0.0], Some(0.2)), [true, true]);
}
