//! Mono images among a color camera's: gray patterns that were taken, or saved, with one value a pixel.
//!
//! Such an image has no white of its own. Its value is compared with the gray of the flash, and what comes out, one
//! share of light a pixel, stands in all three channels.

use crate::image::Image;

/// How much of a mono value is red, green and blue: the luma of Rec. ITU-R BT.601, section 2.5.1, by which OpenCV
/// (`cvtColor`), Pillow (`convert("L")`) and most cameras make gray. For gray objects any weights would do.
pub const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

/// Returns the mono image that a linear image of three channels would have been, by [`LUMA`]. ≥ 1 (clipped) where any
/// channel is.
pub fn luma(image: &Image) -> Image {
    let value = |p: &[f32]| {
        let clipped = p.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        if clipped >= 1.0 { clipped } else { p.iter().zip(LUMA).map(|(v, w)| v * w).sum() }
    };
    Image { channels: 1, data: image.data.chunks_exact(3).map(value).collect(), ..*image }
}

/// Returns the color image whose channels all have the same ratio to the flash: that of `mono` to the flash's gray. All
/// are linear and of one size; `mono` has one channel, `white` and `black` have three. A pixel that is clipped in
/// `mono` or `white` is clipped in all channels.
pub fn spread_mono(mono: &Image, white: &Image, black: Option<&Image>) -> Image {
    let mut out = Image::new(mono.width, mono.height, 3);
    let bright = luma(white);
    let dark = black.map(luma);
    for (i, px) in out.data.chunks_exact_mut(3).enumerate() {
        let (taken, w, b) = (mono.data[i], bright.data[i], dark.as_ref().map_or(0.0, |d| d.data[i]));
        if taken >= 1.0 || w >= 1.0 {
            px.fill(taken.max(w));
            continue;
        }
        // Where there is no light there is no ratio either; whoever normalizes leaves the pixel out.
        let ratio = if w - b > 1e-6 { (taken - b) / (w - b) } else { 0.0 };
        for (c, v) in px.iter_mut().enumerate() {
            let b = black.map_or(0.0, |image| image.data[3 * i + c]);
            *v = (b + (white.data[3 * i + c] - b) * ratio).min(1.0 - f32::EPSILON);
        }
    }
    out
}
