use nelu3d::reconstruct::filter::partly_covered::reject_partly_covered;
use nelu3d::surface::PixelStatus;

use crate::sensor::measurements::mid_gray;

#[test]
fn a_rim_that_covers_less_than_half_of_a_pixel_is_no_surface() {
    // Columns 4 to 15 have a depth: 4 and 15 are the outline, of which 4 is bright, and 14 and 15 are dim.
    let (w, h) = (20, 9);
    let mut m = mid_gray(w, h, 1);
    let mut depth: Vec<f32> = (0..w * h).map(|i| if (4..16).contains(&(i % w)) { 700.0 } else { f32::NAN }).collect();
    m.contrast = (0..w * h).map(|i| [0.5, 0.2, 0.1][(i % w).saturating_sub(13).min(2)]).collect();
    // A dark texture inside is no outline.
    m.contrast[4 * w + 9] = 0.05;
    reject_partly_covered(&mut depth, &mut m, 0.5);
    let kept: Vec<usize> = (0..w).filter(|x| depth[4 * w + x].is_finite()).collect();
    assert_eq!(kept, (4..14).collect::<Vec<_>>());
    assert_eq!(m.status[4 * w + 15], PixelStatus::DepthDiscontinuity);
    assert_eq!(m.status[4 * w + 9], PixelStatus::Valid);
}
