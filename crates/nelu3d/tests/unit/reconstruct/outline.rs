use nelu3d::reconstruct::outline::sigma_of_place;
use nelu3d::surface::Links;
use nelu3d_scan::Camera;

/// Half a step at an outline, a quarter beside it, nothing farther in; where the image ends is no outline.
#[test]
fn an_outline_is_known_to_half_a_pixel() {
    let (w, h) = (12, 9);
    let camera = Camera::pinhole(w, h, 100.0, 100.0, 5.5, 4.0);
    // Steps of 2 mm to the right and of 1 mm down; the surface ends behind column 7.
    let depth: Vec<f32> =
        (0..w * h).map(|i| if i % w < 8 { 500.0 + 2.0 * (i % w) as f32 + (i / w) as f32 } else { f32::NAN }).collect();
    let sigma = sigma_of_place(&depth, &Links::new(&depth, &camera, 4.0), w);
    for (i, s) in sigma.iter().enumerate() {
        let expected = match i % w {
            7 => 1.0,
            6 => 0.5,
            _ => 0.0,
        };
        assert_eq!(*s, expected, "column {}, row {}", i % w, i / w);
    }
}

/// At a jump both surfaces have an outline, and the jump is no step of either.
#[test]
fn a_jump_is_an_outline_of_both_surfaces() {
    let (w, h) = (12, 5);
    let camera = Camera::pinhole(w, h, 100.0, 100.0, 5.5, 2.0);
    let depth: Vec<f32> = (0..w * h).map(|i| if i % w < 6 { 500.0 } else { 600.0 } + (i % w) as f32).collect();
    let sigma = sigma_of_place(&depth, &Links::new(&depth, &camera, 4.0), w);
    assert_eq!(sigma[2 * w..3 * w], [0.0, 0.0, 0.0, 0.0, 0.25, 0.5, 0.5, 0.25, 0.0, 0.0, 0.0, 0.0]);
}
