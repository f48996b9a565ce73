use nelu3d::reconstruct::filter::fading::{Outline, Region, rejected};

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

fn region(size: usize, fades: Option<f64>, chi2: f32, tries: f32) -> Region {
    Region { size, fades, chi2, tries }
}

#[test]
fn what_fades_is_rejected_where_it_is_odd_and_other_regions_end_at_edges() {
    let object = region(10_000, None, 0.9, 0.1);
    let regions = [object, region(800, Some(0.95), 1.0, 4.0), region(800, Some(0.95), 2.5, 0.5)];
    assert_eq!(rejected(&regions), [false, true, true]);
    // Not odd; not clear; nothing to compare with.
    assert_eq!(rejected(&[object, region(800, Some(0.95), 1.0, 0.5), region(800, Some(0.85), 1.0, 4.0)]), [false; 3]);
    assert_eq!(rejected(&[region(800, Some(0.95), 1.0, 4.0)]), [false]);
    assert_eq!(rejected(&[region(800, Some(0.95), 1.0, 20.0)]), [true]);
}

/// Pieces of a wall beside an object under film, as one of the random scanners has them.
#[test]
fn what_chance_explains_many_times_over_has_to_fit_as_well_as_the_rest() {
    let object = region(14_300, None, 0.36, 1.5);
    let wall = [region(309, Some(0.81), 0.72, 120.0), region(295, None, 0.69, 94.0), region(77, None, 0.87, 472.0)];
    let regions: Vec<Region> = [object].into_iter().chain(wall).collect();
    assert_eq!(rejected(&regions), [false, true, true, true]);
    // A small part of the object; and where nothing is supported, nothing says how well that fits.
    assert_eq!(rejected(&[object, region(300, None, 0.4, 100.0)]), [false; 2]);
    assert_eq!(rejected(&wall), [false; 3]);
}
