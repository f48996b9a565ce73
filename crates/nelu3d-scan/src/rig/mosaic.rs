//! Raw mosaics: normalized before they are demosaiced.
//!
//! Demosaicing guesses colors from neighbors, and guesses wrongly where a surface has an edge, in pattern and flash
//! alike but not equally. The ratio of the two raw mosaics knows no surface, only light, which is smooth: demosaiced,
//! it is right where the images are not.

use crate::image::bayer::REACH;
use crate::image::{Image, demosaic};

/// Smallest flash of the pixels that a ratio is taken from, linear: below, it is noise, and the images are demosaiced
/// as they are.
const MIN_LIGHT: f32 = 0.02;

/// Returns a pattern's image of three channels whose ratio to the flash is that of the mosaics. All images are linear
/// mosaics of one channel with the cell `cell`; `white_rgb` and `black_rgb` are demosaiced. A value is ≥ 1 if and only
/// if a mosaic pixel that went into it was.
pub fn pattern_of_mosaic(
    pattern: &Image,
    white: &Image,
    black: Option<&Image>,
    white_rgb: &Image,
    black_rgb: Option<&Image>,
    cell: [u8; 4],
) -> Image {
    let dark = |i: usize| black.map_or(0.0, |b| b.data[i]);
    let light: Vec<f32> = white.data.iter().enumerate().map(|(i, w)| w - dark(i)).collect();
    let ratio: Vec<f32> =
        pattern.data.iter().zip(&light).enumerate().map(|(i, (p, l))| (p - dark(i)) / l.max(MIN_LIGHT)).collect();
    // Ratios may exceed 1, which demosaicing would take for clipped: halved, and cut off where they mean nothing.
    let halved = Image { data: ratio.iter().map(|r| (0.5 * r).clamp(-0.4, 0.95)).collect(), ..pattern.clone() };
    let ratio = demosaic(&halved, cell);
    let mut out = demosaic(pattern, cell);
    let enough = enough_around(&light, pattern.width, pattern.height);
    for i in (0..light.len()).filter(|i| enough[*i]) {
        for c in 3 * i..3 * i + 3 {
            if out.data[c] < 1.0 && white_rgb.data[c] < 1.0 {
                let dark = black_rgb.map_or(0.0, |b| b.data[c]);
                let value = dark + (white_rgb.data[c] - dark) * 2.0 * ratio.data[c];
                out.data[c] = value.min(1.0 - f32::EPSILON);
            }
        }
    }
    out
}

/// Returns whether all pixels that demosaicing looks at have enough light.
fn enough_around(light: &[f32], w: usize, h: usize) -> Vec<bool> {
    let reach = |i: usize, n: usize| i.saturating_sub(REACH)..(i + REACH + 1).min(n);
    let mut along = vec![true; w * h];
    for (along, light) in along.chunks_exact_mut(w.max(1)).zip(light.chunks_exact(w.max(1))) {
        for dim in (0..w).filter(|x| light[*x] < MIN_LIGHT) {
            along[reach(dim, w)].fill(false);
        }
    }
    let mut out = vec![true; w * h];
    for (y, out) in out.chunks_exact_mut(w.max(1)).enumerate() {
        for row in reach(y, h) {
            out.iter_mut().zip(&along[row * w..]).for_each(|(out, along)| *out &= along);
        }
    }
    out
}
