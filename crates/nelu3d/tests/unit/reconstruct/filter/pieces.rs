use nelu3d::reconstruct::filter::pieces::pieces;
use nelu3d::surface::{Links, MAX_SLOPE};
use nelu3d_scan::Camera;

/// The pieces of a flat surface, 80 × 40 px, whose misfit and brightness are given by column, and their sizes.
fn split(misfit: impl Fn(usize) -> f32, light: impl Fn(usize) -> f32) -> (Vec<u32>, Vec<u32>) {
    let camera = Camera::pinhole(80, 40, 500.0, 500.0, 40.0, 20.0);
    let map = |of: &dyn Fn(usize) -> f32| (0..camera.n_pixels()).map(|i| of(i % 80)).collect::<Vec<f32>>();
    let (depth, light, misfit) = (map(&|_| 700.0), map(&light), map(&misfit));
    pieces(Links::new(&depth, &camera, MAX_SLOPE), &depth, &light, &misfit, &camera)
}

/// The number of pieces.
fn count(misfit: impl Fn(usize) -> f32, light: impl Fn(usize) -> f32) -> usize {
    let (_, sizes) = split(misfit, light);
    assert_eq!(sizes.iter().sum::<u32>(), 80 * 40);
    sizes.len()
}

#[test]
fn a_surface_that_is_explained_is_one_piece() {
    assert_eq!(count(|_| 0.5, |x| if x < 40 { 0.5 } else { 0.1 }), 1);
}

#[test]
fn what_is_not_explained_behind_an_edge_of_brightness_is_a_piece_of_its_own() {
    let behind = |edge: usize| move |x: usize| if x < edge { 0.5 } else { 3.0 };
    assert_eq!(count(behind(50), |x| if x < 50 { 0.5 } else { 0.3 }), 2);
    // Though it is small: 10 of 80 columns.
    assert_eq!(count(behind(70), |x| if x < 70 { 0.5 } else { 0.3 }), 2);
}

#[test]
fn a_corner_stays_with_its_surface() {
    assert_eq!(count(|x| if x < 70 { 0.5 } else { 3.0 }, |_| 0.5), 1);
    // Nor is a part right that happens to be explained.
    assert_eq!(count(|x| if (30..40).contains(&x) { 0.5 } else { 3.0 }, |_| 0.5), 1);
    // What is half of all is a piece of its own.
    assert_eq!(count(|x| if x < 40 { 0.5 } else { 3.0 }, |_| 0.5), 2);
}

#[test]
fn a_disturbed_rim_stays_with_its_surface_and_not_with_what_is_behind_it() {
    let misfit = |x: usize| if x < 45 { 0.5 } else { 1.5 };
    // Columns 45 to 50 are the rim.
    let light = |x: usize| if x < 51 { 0.5 } else { 0.25 };
    let (piece, _) = split(misfit, light);
    assert_eq!(piece[0], piece[48]);
    assert_ne!(piece[0], piece[60]);
}
