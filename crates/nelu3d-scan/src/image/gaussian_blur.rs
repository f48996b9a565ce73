//! Gaussian blur.

use rayon::prelude::*;

use super::Image;

/// Standard deviation below which nothing is blurred, px: the kernel would be a single pixel.
const MIN_SIGMA: f32 = 0.05;

/// Blurs an image of one channel with a Gaussian of standard deviation `sigma`, px, cut off at three standard
/// deviations. Beyond its borders the image is mirrored.
///
/// # Panics
///
/// If the image has more than one channel.
pub fn gaussian_blur(image: &Image, sigma: f32) -> Image {
    assert_eq!(image.channels, 1, "one channel is blurred at a time");
    if sigma < MIN_SIGMA {
        return image.clone();
    }
    let radius = (3.0 * sigma).ceil() as isize;
    let mut kernel: Vec<f32> = (-radius..=radius).map(|i| (-(i * i) as f32 / (2.0 * sigma * sigma)).exp()).collect();
    let sum: f32 = kernel.iter().sum();
    kernel.iter_mut().for_each(|k| *k /= sum);
    let (w, h) = (image.width, image.height);
    let mirror = |i: isize, n: usize| {
        let (i, n) = (i.abs(), n as isize);
        (if i >= n { 2 * n - 2 - i } else { i }).clamp(0, n - 1) as usize
    };
    // Along x every row is mirrored beyond its ends first; along y rows are added whole. Neither tests for borders in
    // its inner loop.
    let mut across = vec![0.0f32; w * h];
    across.par_chunks_mut(w).zip(image.data.par_chunks(w)).for_each_init(
        || vec![0.0f32; w + 2 * radius as usize],
        |padded, (out, row)| {
            for (i, v) in padded.iter_mut().enumerate() {
                *v = row[mirror(i as isize - radius, w)];
            }
            for (k, weight) in kernel.iter().enumerate() {
                out.iter_mut().zip(&padded[k..]).for_each(|(out, v)| *out += weight * v);
            }
        },
    );
    let mut data = vec![0.0f32; w * h];
    data.par_chunks_mut(w).enumerate().for_each(|(y, out)| {
        for (k, weight) in kernel.iter().enumerate() {
            let from = mirror(y as isize + k as isize - radius, h) * w;
            out.iter_mut().zip(&across[from..from + w]).for_each(|(out, v)| *out += weight * v);
        }
    });
    Image { data, ..*image }
}
