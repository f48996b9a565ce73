//! An image at every amount of Gaussian blur, for lookups with a blur that changes from point to point.

use std::sync::OnceLock;

use nelu3d_scan::Image;

/// Levels of growing blur, made when first needed. Lookups interpolate between two levels and between pixels.
#[derive(Debug)]
pub(crate) struct BlurStack {
    levels: Vec<OnceLock<Image>>,
}

/// Added standard deviation of level 1, px, and its growth per level: level i > 0 has `FIRST · GROWTH^(i−1)`.
const FIRST_PX: f64 = 0.4;
const GROWTH: f64 = 1.5;
/// The last level has 53 px: more blur than that is clamped.
const N_LEVELS: usize = 14;

/// Variance of linear interpolation between pixels, px²: that of a triangle of half width 1.
const INTERPOLATION_VARIANCE: f64 = 1.0 / 6.0;

impl BlurStack {
    pub(crate) fn new(image: Image) -> Self {
        let levels: Vec<OnceLock<Image>> = (0..N_LEVELS).map(|_| OnceLock::new()).collect();
        levels[0].set(image).expect("new");
        Self { levels }
    }

    /// Channels of the image.
    pub(crate) fn channels(&self) -> usize {
        self.level(0).channels
    }

    fn level(&self, i: usize) -> &Image {
        self.levels[i].get_or_init(|| gaussian(self.levels[0].get().expect("set by new"), level_variance(i).sqrt()))
    }

    /// The value at (u, v) px under a Gaussian of standard deviation `sigma` px; all channels, mono in the first. Outside
    /// of the image it is dark. A blur narrower than the interpolation's own (0.41 px) is not possible.
    pub(crate) fn at(&self, [u, v]: [f64; 2], sigma: f64) -> [f32; 3] {
        let variance = (sigma * sigma - INTERPOLATION_VARIANCE).max(0.0);
        let i = (1..N_LEVELS).find(|&i| level_variance(i) >= variance).unwrap_or(N_LEVELS - 1);
        let (low, high) = (level_variance(i - 1), level_variance(i));
        // Mixed in proportion to the variances, the mixture has exactly the variance asked for.
        let part = ((variance - low) / (high - low)).clamp(0.0, 1.0) as f32;
        let a = bilinear(self.level(i - 1), u, v);
        if part == 0.0 {
            return a;
        }
        let b = bilinear(self.level(i), u, v);
        std::array::from_fn(|c| a[c] + part * (b[c] - a[c]))
    }
}

/// Variance of level i, px².
fn level_variance(i: usize) -> f64 {
    if i == 0 { 0.0 } else { (FIRST_PX * GROWTH.powi(i as i32 - 1)).powi(2) }
}

fn bilinear(image: &Image, u: f64, v: f64) -> [f32; 3] {
    let (w, h) = (image.width as f64, image.height as f64);
    // NaN is outside too.
    if !(u > -1.0 && v > -1.0 && u < w && v < h) {
        return [0.0; 3];
    }
    let (x, y) = (u.floor(), v.floor());
    let (fx, fy) = ((u - x) as f32, (v - y) as f32);
    let mut sum = [0.0; 3];
    for (dy, wy) in [(0, 1.0 - fy), (1, fy)] {
        for (dx, wx) in [(0, 1.0 - fx), (1, fx)] {
            let (px, py) = (x as i64 + dx, y as i64 + dy);
            if px >= 0 && py >= 0 && px < image.width as i64 && py < image.height as i64 {
                let pixel = image.pixel(px as usize, py as usize);
                for (s, value) in sum.iter_mut().zip(pixel) {
                    *s += wx * wy * value;
                }
            }
        }
    }
    sum
}

/// Blurred by a sampled Gaussian along both axes; dark outside.
fn gaussian(image: &Image, sigma: f64) -> Image {
    let radius = (4.0 * sigma).ceil() as i64;
    let taps: Vec<f64> = (-radius..=radius).map(|x| (-0.5 * (x as f64 / sigma).powi(2)).exp()).collect();
    let total: f64 = taps.iter().sum();
    let taps: Vec<f32> = taps.iter().map(|t| (t / total) as f32).collect();
    let pass = |from: &Image, (dx, dy): (i64, i64)| {
        let mut to = Image::new(from.width, from.height, from.channels);
        let (w, h, n) = (from.width as i64, from.height as i64, from.channels as i64);
        for y in 0..h {
            for x in 0..w {
                for (k, tap) in taps.iter().enumerate() {
                    let offset = k as i64 - radius;
                    let (sx, sy) = (x + dx * offset, y + dy * offset);
                    if sx < 0 || sy < 0 || sx >= w || sy >= h {
                        continue;
                    }
                    for c in 0..n {
                        to.data[((y * w + x) * n + c) as usize] += tap * from.data[((sy * w + sx) * n + c) as usize];
                    }
                }
            }
        }
        to
    };
    pass(&pass(image, (1, 0)), (0, 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Gaussian of standard deviation s leaves exp(−½ (2π s / period)²) of a sinusoid's amplitude.
    #[test]
    fn a_sinusoid_loses_the_amplitude_its_blur_says() {
        let period = 24.0;
        let wave = |u: f64| (std::f64::consts::TAU * u / period).cos();
        let data = (0..400 * 9).map(|i| wave((i % 400) as f64) as f32).collect();
        let stack = BlurStack::new(Image { width: 400, height: 9, channels: 1, data });
        for sigma in [0.5, 0.8, 1.3, 2.0, 4.0] {
            // Rows blur into the dark outside; so compare with the blur of a constant image.
            let white = BlurStack::new(Image { width: 400, height: 9, channels: 1, data: vec![1.0; 3600] });
            let expected = (-0.5 * (std::f64::consts::TAU * sigma / period).powi(2)).exp();
            for u in [150.0, 152.4, 160.7, 169.1] {
                let got = f64::from(stack.at([u, 4.0], sigma)[0] / white.at([u, 4.0], sigma)[0]);
                assert!((got - expected * wave(u)).abs() < 0.004, "{sigma} at {u}: {got}, {}", expected * wave(u));
            }
        }
    }

    #[test]
    fn outside_is_dark() {
        let stack = BlurStack::new(Image { width: 4, height: 4, channels: 3, data: vec![1.0; 48] });
        assert_eq!(stack.at([-1.5, 1.0], 0.1), [0.0; 3]);
        assert_eq!(stack.at([f64::NAN, 1.0], 0.1), [0.0; 3]);
        assert_eq!(stack.at([1.5, 1.0], 0.1), [1.0; 3]);
    }
}
