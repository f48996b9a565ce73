//! Means over the pixels of a surface.

use nelu3d_scan::image::box_mean;

/// Returns the means of a map of width `w` and height `h` over squares of the given radius, of active pixels alone; 0
/// where a square has none.
pub(in crate::reconstruct::refine) fn masked_mean(
    v: &[f32],
    active: &[bool],
    w: usize,
    h: usize,
    radius: usize,
) -> Vec<f32> {
    let mut sum: Vec<f32> = v.iter().zip(active).map(|(v, a)| if *a { *v } else { 0.0 }).collect();
    let mut count: Vec<f32> = active.iter().map(|a| if *a { 1.0 } else { 0.0 }).collect();
    box_mean(&mut sum, w, h, radius);
    box_mean(&mut count, w, h, radius);
    sum.iter().zip(&count).map(|(s, c)| if *c > 0.0 { s / c } else { 0.0 }).collect()
}
