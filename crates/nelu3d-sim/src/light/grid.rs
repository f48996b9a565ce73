//! A projector's image as light: squares of light with dark gaps between them, under the lens's blur.

use std::sync::LazyLock;

use nelu3d_scan::Image;

use super::blur::BlurStack;

/// The images of a projector, their channels side by side. Each pixel is an evenly lit square about its center, of the
/// same side for all; the lens blurs by a Gaussian.
#[derive(Debug)]
pub(crate) struct PixelGrid {
    stack: BlurStack,
    /// Side of a lit square, px.
    fill: f64,
}

/// Below this standard deviation, px, the squares are integrated one by one. From here on their grid is gone (its first
/// harmonic is 1.3e-4 of the mean, whatever the fill factor) and they are Gaussians of their own variance to the lens.
const NARROW_PX: f64 = 0.7;

/// The Gaussian is cut where less than 7e-5 of it is left.
const REACH_SIGMAS: f64 = 4.0;

/// Maximum number of pixels along an axis that a narrow blur reaches: 2 · (4 · 0.7 + ½), and one for the offset.
const MAX_PIXELS: usize = 8;

impl PixelGrid {
    /// Returns a grid of all channels of `images`, which have the same size; `fill` is the side of a lit square, px.
    pub(crate) fn new(images: &[Image], fill: f64) -> Self {
        Self { stack: BlurStack::new(images), fill }
    }

    /// Returns the number of channels of all images together.
    pub(crate) fn channels(&self) -> usize {
        self.stack.channels()
    }

    /// Writes all channels at (u, v) px under a lens blur of standard deviation `sigma` px to `out`; 1 inside a sharp
    /// white square.
    pub(crate) fn at(&self, at: [f64; 2], sigma: f64, out: &mut [f32]) {
        if sigma < NARROW_PX {
            self.squares(at, sigma.max(1e-4), out);
        } else {
            let square = self.fill * self.fill;
            self.stack.at(at, (sigma * sigma + square / 12.0).sqrt(), out);
            out.iter_mut().for_each(|v| *v *= square as f32);
        }
    }

    /// Writes `Σ code(i, j) · W(u − i) · W(v − j)`, `W(d) = Φ((d + f/2) / σ) − Φ((d − f/2) / σ)`: the exact integral of
    /// the squares under the Gaussian.
    fn squares(&self, [u, v]: [f64; 2], sigma: f64, out: &mut [f32]) {
        // White and two to six patterns keep their sums in registers.
        match out.len() {
            3 => self.squares_of::<3>([u, v], sigma, out),
            4 => self.squares_of::<4>([u, v], sigma, out),
            5 => self.squares_of::<5>([u, v], sigma, out),
            6 => self.squares_of::<6>([u, v], sigma, out),
            7 => self.squares_of::<7>([u, v], sigma, out),
            _ => {
                out.fill(0.0);
                self.weighted([u, v], sigma, |weight, pixel| {
                    out.iter_mut().zip(pixel).for_each(|(o, p)| *o += weight * p);
                });
            }
        }
    }

    /// Writes all N channels at (u, v) px under a blur of standard deviation `sigma` px to `out`, as [`Self::squares`].
    fn squares_of<const N: usize>(&self, at: [f64; 2], sigma: f64, out: &mut [f32]) {
        let mut sums = [0.0; N];
        self.weighted(at, sigma, |weight, pixel| {
            let pixel: &[f32; N] = pixel.try_into().expect("all channels of a pixel");
            sums.iter_mut().zip(pixel).for_each(|(o, p)| *o += weight * p);
        });
        out.copy_from_slice(&sums);
    }

    /// Calls `add` with the weight and the channels of every pixel in reach.
    #[inline]
    fn weighted(&self, [u, v]: [f64; 2], sigma: f64, mut add: impl FnMut(f32, &[f32])) {
        let (first_column, wx, nx) = self.weights(u, sigma);
        let (first_row, wy, ny) = self.weights(v, sigma);
        let [columns, rows] =
            self.stack.inside(first_column..first_column + nx as i64, first_row..first_row + ny as i64);
        let wx = &wx[(columns.start - first_column).clamp(0, nx as i64) as usize..];
        for row in rows {
            let wy = wy[(row - first_row) as usize];
            let pixels = self.stack.sharp_row(row, columns.clone());
            for (pixel, wx) in pixels.chunks_exact(self.stack.channels()).zip(wx) {
                add(wx * wy, pixel);
            }
        }
    }

    /// Returns the first pixel in reach along an axis, and the weights of as many as are. Indices may lie outside of
    /// the image.
    fn weights(&self, at: f64, sigma: f64) -> (i64, [f32; MAX_PIXELS], usize) {
        let mut weights = [0.0; MAX_PIXELS];
        let reach = 0.5 * self.fill + REACH_SIGMAS * sigma;
        // NaN and places far outside are dark.
        if at.is_nan() || at.abs() > 1e9 {
            return (0, weights, 0);
        }
        let (first, last) = ((at - reach).ceil() as i64, (at + reach).floor() as i64);
        let n = (last - first + 1).clamp(0, MAX_PIXELS as i64) as usize;
        // In units of the table, from its first entry: where Φ is looked up for the middle of the first square.
        let per_px = STEPS as f64 / sigma;
        let middle = (at - first as f64) * per_px + (END * STEPS) as f64;
        let half = 0.5 * self.fill * per_px;
        let table = NORMAL_CDF.as_slice();
        if self.fill == 1.0 {
            // Without gaps a square begins where the one before ends.
            let mut before = normal_cdf(table, middle + half);
            for (i, w) in weights[..n].iter_mut().enumerate() {
                let after = normal_cdf(table, middle - half - i as f64 * per_px);
                *w = (before - after) as f32;
                before = after;
            }
        } else {
            for (i, w) in weights[..n].iter_mut().enumerate() {
                let d = middle - i as f64 * per_px;
                *w = (normal_cdf(table, d + half) - normal_cdf(table, d - half)) as f32;
            }
        }
        (first, weights, n)
    }
}

/// Entries of Φ's table per unit, and where it ends.
const STEPS: usize = 256;
const END: usize = 6;

/// Φ from −6 to 6, by Simpson's rule from step to step.
static NORMAL_CDF: LazyLock<Vec<f64>> = LazyLock::new(|| {
    let density = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    let h = 1.0 / STEPS as f64;
    let mut sum = 1e-9;
    (0..=2 * END * STEPS)
        .map(|i| {
            let x = i as f64 * h - END as f64;
            let here = sum;
            sum += h / 6.0 * (density(x) + 4.0 * density(x + 0.5 * h) + density(x + h));
            here
        })
        .collect()
});

/// Returns the normal distribution's cumulative function Φ(x) to 1e-6 at `at = (x + END) · STEPS`, a place in its table.
fn normal_cdf(table: &[f64], at: f64) -> f64 {
    const LAST: usize = 2 * END * STEPS;
    let table: &[f64; LAST + 1] = table.try_into().expect("of this length");
    // Beyond the ends it is 0 or 1 to 1e-9.
    let at = at.clamp(0.0, LAST as f64 - 1e-6);
    let i = (at as usize).min(LAST - 1);
    table[i] + (at - i as f64) * (table[i + 1] - table[i])
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;

    fn image(width: usize, height: usize, value: impl Fn(usize, usize) -> f64) -> Image {
        let data = (0..width * height).map(|i| value(i % width, i / width) as f32).collect();
        Image { width, height, channels: 1, data }
    }

    fn at(grid: &PixelGrid, u: f64, v: f64, sigma: f64) -> f64 {
        let mut out = [0.0];
        grid.at([u, v], sigma, &mut out);
        f64::from(out[0])
    }

    #[test]
    fn the_tabled_function_is_the_normal_one() {
        // Abramowitz and Stegun, table 26.1.
        let normal_cdf = |x: f64| normal_cdf(&NORMAL_CDF, (x + END as f64) * STEPS as f64);
        for (x, expected) in [(0.0, 0.5), (0.5, 0.691_462_461), (1.0, 0.841_344_746), (2.5, 0.993_790_335)] {
            assert!((normal_cdf(x) - expected).abs() < 1e-6 && (normal_cdf(-x) - 1.0 + expected).abs() < 1e-6, "{x}");
        }
        assert!(normal_cdf(-7.0).abs() < 2e-9 && (normal_cdf(1e9) - 1.0).abs() < 2e-9);
    }

    /// White, along a line through the middles of the pixels: the product of two Fourier series with coefficients
    /// `f sinc(k f) exp(−2 π² k² σ²)`.
    #[test]
    fn gaps_modulate_white_as_the_fourier_series_says() {
        for fill in [0.5, 0.78, 1.0] {
            let grid = PixelGrid::new(&[image(24, 20, |_, _| 1.0)], fill);
            for sigma in [0.1, 0.25, 0.4, 0.6, 0.69, 0.71, 1.0, 2.0] {
                let line = |x: f64| {
                    let term = |k: i32| {
                        let k = f64::from(k);
                        2.0 * (PI * k * fill).sin() / (PI * k)
                            * (-2.0 * (PI * k * sigma).powi(2)).exp()
                            * (TAU * k * x).cos()
                    };
                    fill + (1..40).map(term).sum::<f64>()
                };
                for (x, y) in [(0.0, 0.0), (0.2, 0.1), (0.5, 0.0), (0.5, 0.5), (0.37, 0.81)] {
                    let (got, expected) = (at(&grid, 11.0 + x, 9.0 + y, sigma), line(x) * line(y));
                    assert!((got - expected).abs() < 4e-4, "fill {fill}, sigma {sigma}: {got}, not {expected}");
                }
            }
        }
    }

    /// Squares and blur stack, on both sides of the change from one to the other, for the finest patterns there are.
    #[test]
    fn the_change_to_the_blur_stack_is_bounded() {
        type Value = fn(usize, usize) -> f64;
        let patterns: [(&str, Value, f64); 4] = [
            ("white", |_, _| 1.0, 4e-4),
            ("sinusoid of 8 px", |x, _| 0.5 + 0.5 * (TAU * x as f64 / 8.0).cos(), 0.003),
            ("edge", |x, _| f64::from(u8::from(x >= 20)), 0.02),
            ("stripes of 1 px", |x, _| (x % 2) as f64, 0.045),
        ];
        for (name, value, limit) in patterns {
            for fill in [0.6, 0.9, 1.0] {
                let grid = PixelGrid::new(&[image(40, 32, value)], fill);
                let mut worst: f64 = 0.0;
                for i in 0..60 {
                    let (u, v) = (18.0 + 0.07 * f64::from(i), 14.3 + 0.02 * f64::from(i));
                    let below = at(&grid, u, v, NARROW_PX - 1e-9);
                    worst = worst.max((below - at(&grid, u, v, NARROW_PX + 1e-9)).abs() / (fill * fill));
                }
                eprintln!("{name}, fill {fill}: {worst:.5} of white");
                assert!(worst < limit, "{name}, fill {fill}: {worst}");
            }
        }
    }

    #[test]
    fn a_pixel_has_the_light_and_variance_of_its_square_and_blur() {
        let one = image(41, 41, |x, y| f64::from(u8::from(x == 20 && y == 20)));
        for (fill, sigma) in [(0.6, 0.3), (1.0, 0.5), (0.8, 0.65)] {
            let grid = PixelGrid::new(std::slice::from_ref(&one), fill);
            let n = 20;
            let (mut sum, mut square) = (0.0, 0.0);
            for i in -8 * n..8 * n {
                for j in -8 * n..8 * n {
                    let [x, y] = [i, j].map(|k| (f64::from(k) + 0.5) / f64::from(n));
                    let value = at(&grid, 20.0 + x, 20.0 + y, sigma) / f64::from(n * n);
                    sum += value;
                    square += value * x * x;
                }
            }
            let expected = sigma * sigma + fill * fill / 12.0;
            assert!((sum / (fill * fill) - 1.0).abs() < 1e-3, "{sum}");
            assert!((square / sum / expected - 1.0).abs() < 0.01, "{} instead of {expected}", square / sum);
        }
    }

    #[test]
    fn outside_is_dark() {
        let grid = PixelGrid::new(&[image(4, 4, |_, _| 1.0)], 1.0);
        for (u, v, expected) in
            [(-1.5, 1.0, 0.0), (f64::NAN, 1.0, 0.0), (f64::INFINITY, 0.0, 0.0), (1.5, 1.0, 1.0), (3.5, 1.0, 0.5)]
        {
            assert!((at(&grid, u, v, 0.1) - expected).abs() < 1e-6, "{u}, {v}");
        }
    }
}
