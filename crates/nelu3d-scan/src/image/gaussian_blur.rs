//! Gaussian blur.

use rayon::prelude::*;

use super::Image;

/// Standard deviation below which nothing is blurred, px: the kernel would be a single pixel.
const MIN_SIGMA: f32 = 0.05;

/// Blurs an image of one channel with a Gaussian of standard deviation `sigma`, px, cut off at three standard deviations.
/// Beyond its borders the image is mirrored.
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
    let (w, h) = (image.width as isize, image.height as isize);
    let mirror = |i: isize, n: isize| {
        let m = if i < 0 { -i } else { i };
        (if m >= n { 2 * n - 2 - m } else { m }).clamp(0, n - 1)
    };
    let pass = |src: &[f32], horizontal: bool| -> Vec<f32> {
        (0..w * h)
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i % w, i / w);
                let tap = |o: isize| {
                    let (sx, sy) = if horizontal { (mirror(x + o, w), y) } else { (x, mirror(y + o, h)) };
                    src[(sy * w + sx) as usize]
                };
                kernel.iter().enumerate().map(|(k, weight)| weight * tap(k as isize - radius)).sum()
            })
            .collect()
    };
    Image { data: pass(&pass(&image.data, true), false), ..*image }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_becomes_a_gaussian_and_a_constant_stays() {
        let mut point = Image::new(21, 21, 1);
        point.data[10 * 21 + 10] = 1.0;
        let blurred = gaussian_blur(&point, 1.5);
        assert!((blurred.data.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        let variance = (0..441).map(|i| blurred.data[i] * ((i % 21) as f32 - 10.0).powi(2)).sum::<f32>();
        // Cut off at three standard deviations, the kernel is a little narrower.
        assert!((variance - 2.25).abs() < 0.1, "{variance}");
        let constant = Image { data: vec![0.4; 441], ..point };
        assert!(gaussian_blur(&constant, 3.0).data.iter().all(|v| (v - 0.4).abs() < 1e-6));
        assert_eq!(gaussian_blur(&constant, 0.0), constant);
    }
}
