mod odd_pattern;
mod response;

use nelu3d::reconstruct::judge::{median_chi2, of_field, residual};
use nelu3d::verdict::Code;

#[test]
fn residuals_of_pixels_without_depth_do_not_count() {
    let depth = [700.0, 700.0, 700.0, f32::NAN, f32::NAN, f32::NAN];
    let judged = |chi2: [f32; 6]| residual(median_chi2(&depth, &chi2).unwrap());
    assert!(judged([1.0, 0.9, 1.2, 50.0, 50.0, 50.0]).is_none());
    let found = judged([9.0, 8.0, 10.0, 1.0, 1.0, 1.0]).unwrap();
    assert!(found.code == Code::ResidualAboveNoise && found.sentence.contains("3.0 times"), "{found}");
}

#[test]
fn a_doubtful_field_makes_doubtful_surfaces() {
    assert!(of_field(&[]).is_none() && of_field(&["clipped".into()]).unwrap().sentence.contains("clipped"));
}
