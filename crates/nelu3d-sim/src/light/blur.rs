//! A stack of images at every amount of Gaussian blur, for lookups with a blur that changes from point to point.

use std::ops::Range;
use std::sync::OnceLock;

use nelu3d_scan::Image;

/// Images of one size, their channels side by side, at levels of growing blur that are made when first needed. A lookup
/// reads all channels at once and interpolates between two levels and (quadratic B-spline) between pixels. Outside of
/// the images it is dark.
#[derive(Debug)]
pub struct BlurStack {
    width: usize,
    height: usize,
    channels: usize,
    /// `(height + 4) × (width + 4) × channels`: a dark border of two pixels saves the lookups every check of bounds.
    levels: Vec<OnceLock<Vec<f32>>>,
    /// Variance of each level's blur, px².
    variances: [f64; N_LEVELS],
}

/// Added standard deviation of level 1, px, and its growth per level: level i > 0 has `FIRST · GROWTH^(i−1)`.
const FIRST_PX: f64 = 0.4;
const GROWTH: f64 = 1.25;
/// The last level has 54 px: more blur than that is clamped.
const N_LEVELS: usize = 24;

/// Dark pixels around the images, as far as an interpolation from inside reaches.
const BORDER: usize = 2;

/// Variance of the interpolation between pixels, px²: that of a quadratic B-spline, three boxes of a pixel.
const INTERPOLATION_VARIANCE: f64 = 0.25;

impl BlurStack {
    /// Returns a stack of all channels of `images`.
    ///
    /// # Panics
    ///
    /// If there is no image, or they are not of one size.
    pub fn new(images: &[Image]) -> Self {
        let (width, height) = (images[0].width, images[0].height);
        assert!(images.iter().all(|i| i.width == width && i.height == height), "images of one size");
        let channels = images.iter().map(|i| i.channels).sum();
        let mut sharp = vec![0.0; (width + 2 * BORDER) * (height + 2 * BORDER) * channels];
        for y in 0..height {
            for x in 0..width {
                let at = ((y + BORDER) * (width + 2 * BORDER) + x + BORDER) * channels;
                let values = images.iter().flat_map(|i| i.pixel(x, y));
                sharp[at..at + channels].iter_mut().zip(values).for_each(|(s, v)| *s = *v);
            }
        }
        let levels: Vec<OnceLock<Vec<f32>>> = (0..N_LEVELS).map(|_| OnceLock::new()).collect();
        levels[0].set(sharp).expect("new");
        let mut variances = [0.0; N_LEVELS];
        for (i, v) in variances.iter_mut().enumerate().skip(1) {
            *v = (FIRST_PX * GROWTH.powi(i as i32 - 1)).powi(2);
        }
        Self { width, height, channels, levels, variances }
    }

    /// Returns the number of channels of all images together.
    pub(crate) fn channels(&self) -> usize {
        self.channels
    }

    /// Returns the part of a range of columns and the part of a range of rows that lie in the images.
    pub(crate) fn inside(&self, columns: Range<i64>, rows: Range<i64>) -> [Range<i64>; 2] {
        let within = |range: Range<i64>, n: usize| {
            let first = range.start.clamp(0, n as i64);
            first..range.end.clamp(first, n as i64)
        };
        [within(columns, self.width), within(rows, self.height)]
    }

    /// Returns pixels of a row without blur, all channels of each; they lie in the images.
    pub(crate) fn sharp_row(&self, y: i64, columns: Range<i64>) -> &[f32] {
        let row = (y as usize + BORDER) * (self.width + 2 * BORDER);
        let [first, end] = [columns.start, columns.end].map(|x| (row + x as usize + BORDER) * self.channels);
        &self.level(0)[first..end]
    }

    /// Writes all channels at (u, v) px under a Gaussian of standard deviation `sigma` px to `out`, which holds as many
    /// values. A blur narrower than the interpolation's own (0.5 px) is not possible.
    pub fn at(&self, [u, v]: [f64; 2], sigma: f64, out: &mut [f32]) {
        out.fill(0.0);
        // NaN is outside too.
        if !(u > -1.5 && v > -1.5 && u < self.width as f64 + 0.5 && v < self.height as f64 + 0.5) {
            return;
        }
        let (x, y) = ((u + 0.5).floor(), (v + 0.5).floor());
        let (wx, wy) = (b_spline((u - x) as f32), b_spline((v - y) as f32));
        let row = (self.width + 2 * BORDER) * self.channels;
        // The pixel before the nearest one on either axis.
        let corner = (y + BORDER as f64 - 1.0) as usize * row + (x + BORDER as f64 - 1.0) as usize * self.channels;

        let variance = (sigma * sigma - INTERPOLATION_VARIANCE).max(0.0);
        let i = (1..N_LEVELS - 1).find(|&i| self.variances[i] >= variance).unwrap_or(N_LEVELS - 1);
        let (low, high) = (self.variances[i - 1], self.variances[i]);
        // Mixed in proportion to the variances, the mixture has exactly the variance asked for (and, between close
        // levels, nearly the shape of a Gaussian).
        let part = ((variance - low) / (high - low)).clamp(0.0, 1.0) as f32;
        for (level, part) in [(i - 1, 1.0 - part), (i, part)] {
            if part == 0.0 {
                continue;
            }
            let image = self.level(level);
            for (k, wy) in wy.iter().enumerate() {
                let [a, b, c] = wx.map(|w| part * wy * w);
                let pixels = &image[corner + k * row..][..3 * self.channels];
                let (left, others) = pixels.split_at(self.channels);
                let (middle, right) = others.split_at(self.channels);
                for (((o, l), m), r) in out.iter_mut().zip(left).zip(middle).zip(right) {
                    *o += a * l + b * m + c * r;
                }
            }
        }
    }

    fn level(&self, i: usize) -> &[f32] {
        self.levels[i].get_or_init(|| self.blurred(self.variances[i].sqrt()))
    }

    /// Returns the sharp level under a sampled Gaussian along both axes.
    fn blurred(&self, sigma: f64) -> Vec<f32> {
        let radius = (4.0 * sigma).ceil() as usize + 1;
        let half = sampled_gaussian(sigma * sigma, radius);
        let taps: Vec<f32> = (0..=2 * radius).map(|i| half[i.abs_diff(radius)] as f32).collect();
        let (n, row) = (BORDER * self.channels, (self.width + 2 * BORDER) * self.channels);
        let sharp = self.levels[0].get().expect("set by new");
        // Each pass adds shifted copies; what is shifted over an end is lost in the dark.
        let mut across = vec![0.0; sharp.len()];
        for y in BORDER..BORDER + self.height {
            let (from, to) = (&sharp[y * row + n..(y + 1) * row - n], &mut across[y * row + n..(y + 1) * row - n]);
            add_shifted(from, to, &taps, self.channels);
        }
        let mut both = vec![0.0; sharp.len()];
        let inside = BORDER * row..(BORDER + self.height) * row;
        add_shifted(&across[inside.clone()], &mut both[inside], &taps, row);
        both
    }
}

/// Returns a quadratic B-spline's weights of the pixels before, at and after the nearest one, for a place `d` px in
/// [−½, ½] from it.
pub fn b_spline(d: f32) -> [f32; 3] {
    [0.5 * (0.5 - d) * (0.5 - d), 0.75 - d * d, 0.5 * (0.5 + d) * (0.5 + d)]
}

/// Returns taps 0 to `radius` of a sampled Gaussian whose variance, as a sum over its samples, is `variance`, px².
/// Below 1 px the samples are too few for the sum to equal the parameter of the exponential, which is therefore found
/// by bisection.
pub fn sampled_gaussian(variance: f64, radius: usize) -> Vec<f64> {
    let taps = |t: f64| -> Vec<f64> {
        let half: Vec<f64> = (0..=radius).map(|n| (-0.5 * (n * n) as f64 / t).exp()).collect();
        let total = 2.0 * half.iter().sum::<f64>() - half[0];
        half.into_iter().map(|v| v / total).collect()
    };
    let sum = |half: &[f64]| 2.0 * half.iter().enumerate().map(|(n, v)| (n * n) as f64 * v).sum::<f64>();
    let (mut low, mut high) = (0.5 * variance, 1.1 * variance + 0.5);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if sum(&taps(middle)) < variance { low = middle } else { high = middle }
    }
    taps(0.5 * (low + high))
}

/// Adds shifted copies: `to += Σ_k taps[k] · from shifted by (k − middle) · step`.
fn add_shifted(from: &[f32], to: &mut [f32], taps: &[f32], step: usize) {
    let middle = taps.len() / 2;
    let n = from.len();
    for (k, tap) in taps.iter().enumerate() {
        let shift = k.abs_diff(middle) * step;
        if shift >= n {
            continue;
        }
        let (from, to) =
            if k < middle { (&from[..n - shift], &mut to[shift..]) } else { (&from[shift..], &mut to[..n - shift]) };
        to.iter_mut().zip(from).for_each(|(t, f)| *t += tap * f);
    }
}
