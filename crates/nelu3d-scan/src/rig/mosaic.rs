//! Raw mosaics: normalized before they are demosaiced.
//!
//! Demosaicing guesses colors from neighbors, and guesses wrongly where a surface has an edge, in pattern and flash
//! alike but not equally. The ratio of the two raw mosaics knows no surface, only light, which is smooth: demosaiced,
//! it is right where the images are not.

use crate::image::{Image, demosaic};

/// Smallest flash of the pixels that a ratio is taken from, linear: below, it is noise, and the images are demosaiced
/// as they are.
const MIN_LIGHT: f32 = 0.02;
/// How far demosaicing reaches, px.
const REACH: usize = 2;

/// Returns a pattern's image of three channels whose ratio to the flash is that of the mosaics. All images are linear
/// mosaics of one channel with the cell `cell`; `white_rgb` and `black_rgb` are demosaiced. A value is ≥ 1 if and only
/// if a mosaic pixel that went into it was.
pub(super) fn pattern(
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
    // Down the rows, then along them: the number of pixels in reach since the last dim one.
    let one = |lit: &dyn Fn(usize) -> bool, n: usize| -> Vec<bool> {
        (0..n).map(|i| (i.saturating_sub(REACH)..(i + REACH + 1).min(n)).all(lit)).collect()
    };
    let mut rows = vec![false; w * h];
    for y in 0..h {
        let row = one(&|x| light[y * w + x] >= MIN_LIGHT, w);
        rows[y * w..(y + 1) * w].copy_from_slice(&row);
    }
    let mut out = vec![false; w * h];
    for x in 0..w {
        for (y, lit) in one(&|y| rows[y * w + x], h).into_iter().enumerate() {
            out[y * w + x] = lit;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELL: [u8; 4] = [0, 1, 1, 2];

    /// A checkered surface of saturated colors under smooth light: the ratio of the images is that of the light to a
    /// thousandth, where images demosaiced one by one are wrong by a tenth at its edges.
    #[test]
    fn ratios_do_not_see_the_surface() {
        let (w, h) = (48, 40);
        let albedo = |x: usize, y: usize, c: usize| [[0.7, 0.2, 0.1], [0.15, 0.3, 0.6]][(x / 6 + y / 6) % 2][c];
        let light =
            |x: usize, y: usize, c: usize| 0.5 + 0.3 * (0.15 * x as f32 + 0.1 * y as f32 + 2.0 * c as f32).sin();
        let mosaic = |f: &dyn Fn(usize, usize, usize) -> f32| {
            let mut image = Image::new(w, h, 1);
            for i in 0..w * h {
                let (x, y) = (i % w, i / w);
                image.data[i] = f(x, y, usize::from(CELL[2 * (y % 2) + x % 2]));
            }
            image
        };
        let black = mosaic(&|_, _, _| 0.01);
        let white = mosaic(&|x, y, c| 0.01 + 0.8 * albedo(x, y, c));
        let taken = mosaic(&|x, y, c| 0.01 + 0.8 * albedo(x, y, c) * light(x, y, c));
        let (white_rgb, black_rgb) = (demosaic(&white, CELL), demosaic(&black, CELL));
        let ours = pattern(&taken, &white, Some(&black), &white_rgb, Some(&black_rgb), CELL);
        let plain = demosaic(&taken, CELL);
        let worst = |image: &Image| -> f32 {
            let mut worst = 0.0f32;
            for (x, y) in (4..h - 4).flat_map(|y| (4..w - 4).map(move |x| (x, y))) {
                for c in 0..3 {
                    let i = 3 * (y * w + x) + c;
                    let ratio = (image.data[i] - black_rgb.data[i]) / (white_rgb.data[i] - black_rgb.data[i]);
                    worst = worst.max((ratio - light(x, y, c)).abs());
                }
            }
            worst
        };
        assert!(worst(&ours) < 0.02, "{}", worst(&ours));
        assert!(worst(&plain) > 0.1, "{}", worst(&plain));
    }

    /// Where there is next to no light, and where something is clipped, the image stays as it was.
    #[test]
    fn dim_and_clipped_pixels_stay_as_they_were() {
        let mut white = Image::new(16, 16, 1);
        white.data.iter_mut().enumerate().for_each(|(i, v)| *v = if i % 16 < 8 { 0.005 } else { 0.9 });
        let mut taken = Image { data: white.data.iter().map(|v| 0.5 * v).collect(), ..white.clone() };
        taken.data[8 * 16 + 12] = 1.0;
        let ours = pattern(&taken, &white, None, &demosaic(&white, CELL), None, CELL);
        let plain = demosaic(&taken, CELL);
        for i in 0..16 * 16 {
            let same = ours.pixel(i % 16, i / 16) == plain.pixel(i % 16, i / 16);
            assert!(same || i % 16 >= 10, "{i}");
            let clipped = |image: &Image| image.pixel(i % 16, i / 16).iter().map(|v| *v >= 1.0).collect::<Vec<_>>();
            assert_eq!(clipped(&ours), clipped(&plain), "{i}");
        }
    }
}
