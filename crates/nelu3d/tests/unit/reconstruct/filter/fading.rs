use nelu3d::reconstruct::filter::fading::Outline;

/// An outline of 100 places with these values of χ² in turn, and how many of four foreign codewords are worse.
fn outline(chi2: &[f32], worse: f64) -> Outline {
    let chi2 = chi2.iter().copied().cycle().take(100).collect();
    Outline { chi2, worse: (400.0 * worse) as usize }
}

#[test]
fn an_edge_does_not_fade() {
    assert_eq!(outline(&[8.0, 8.5, 8.9], 0.5).fades(1000), None);
    // Though a third of it has lost its rim.
    assert_eq!(outline(&[1.0, 8.5, 8.9], 0.9).fades(1000), None);
}

#[test]
fn what_goes_on_with_growing_misfit_fades() {
    assert_eq!(outline(&[1.0, 2.0, 5.0], 0.95).fades(1000), Some(0.95));
}

#[test]
fn a_code_that_explains_anything_does_not_tell() {
    assert_eq!(outline(&[0.5, 1.0, 2.0], 0.6).fades(1000), None);
}

#[test]
fn a_short_part_of_an_outline_does_not_tell() {
    assert_eq!(outline(&[1.0, 2.0, 5.0], 0.95).fades(20_000), None);
}
