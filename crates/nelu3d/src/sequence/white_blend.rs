//! The plain way to a white image between two that were taken.

use nelu3d_scan::Image;

/// Returns the mean of two white images, the second with weight `weight`; clipped where either is.
///
/// # Panics
///
/// If they differ in size.
pub fn blend_white(a: &Image, b: &Image, weight: f32) -> Image {
    assert!((a.width, a.height, a.channels) == (b.width, b.height, b.channels), "white images of one camera");
    let blend = |(a, b): (&f32, &f32)| if *a >= 1.0 || *b >= 1.0 { a.max(*b) } else { a * (1.0 - weight) + b * weight };
    Image { data: a.data.iter().zip(&b.data).map(blend).collect(), ..*a }
}
