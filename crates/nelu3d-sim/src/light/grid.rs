//! A projector's image as light: squares of light with dark gaps between them, under the lens's blur.

use std::sync::LazyLock;

use nelu3d_scan::Image;

use super::blur::BlurStack;

/// The images of a projector, their channels side by side. Each pixel is an evenly lit square about its center, of the
/// same side for all; the lens blurs by a Gaussian.
#[derive(Debug)]
pub struct PixelGrid {
    stack: BlurStack,
    /// Side of a lit square, px.
    fill: f64,
}

/// The Gaussian is cut where less than 7e-5 of it is left.
const REACH_SIGMAS: f64 = 4.0;

/// Maximum number of pixels along an axis that a narrow blur reaches: 2 · (4 · 0.7 + ½), and one for the offset.
const MAX_PIXELS: usize = 8;

impl PixelGrid {
    /// Below this standard deviation, px, the squares are integrated one by one. From here on their grid is gone (its
    /// first harmonic is 1.3e-4 of the mean, whatever the fill factor) and they are Gaussians of their own variance to
    /// the lens.
    pub const NARROW_PX: f64 = 0.7;

    /// Returns a grid of all channels of `images`; `fill` is the side of a lit square, px.
    ///
    /// # Panics
    ///
    /// If there is no image, or they are not of one size.
    pub fn new(images: &[Image], fill: f64) -> Self {
        Self { stack: BlurStack::new(images), fill }
    }

    /// Returns the number of channels of all images together.
    pub(crate) fn channels(&self) -> usize {
        self.stack.channels()
    }

    /// Writes all channels at (u, v) px under a lens blur of standard deviation `sigma` px to `out`, which holds as
    /// many values; 1 inside a sharp white square.
    pub fn at(&self, at: [f64; 2], sigma: f64, out: &mut [f32]) {
        if sigma < Self::NARROW_PX {
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
            let mut before = looked_up(table, middle + half);
            for (i, w) in weights[..n].iter_mut().enumerate() {
                let after = looked_up(table, middle - half - i as f64 * per_px);
                *w = (before - after) as f32;
                before = after;
            }
        } else {
            for (i, w) in weights[..n].iter_mut().enumerate() {
                let d = middle - i as f64 * per_px;
                *w = (looked_up(table, d + half) - looked_up(table, d - half)) as f32;
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

/// Returns the normal distribution's cumulative function Φ(x) to 1e-6, from a table.
pub fn normal_cdf(x: f64) -> f64 {
    looked_up(NORMAL_CDF.as_slice(), (x + END as f64) * STEPS as f64)
}

/// Returns Φ(x) to 1e-6 at `at = (x + END) · STEPS`, a place in its table.
fn looked_up(table: &[f64], at: f64) -> f64 {
    const LAST: usize = 2 * END * STEPS;
    let table: &[f64; LAST + 1] = table.try_into().expect("of this length");
    // Beyond the ends it is 0 or 1 to 1e-9.
    let at = at.clamp(0.0, LAST as f64 - 1e-6);
    let i = (at as usize).min(LAST - 1);
    table[i] + (at - i as f64) * (table[i + 1] - table[i])
}
