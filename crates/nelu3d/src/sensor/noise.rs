//! The sensor's noise, estimated from the captures themselves.

use std::sync::LazyLock;

use nelu3d_scan::Image;
use nelu3d_scan::statistics::within_sigmas;
use serde::{Deserialize, Serialize};

/// Variance of a linear intensity I in `[0, 1]`: `read + gain · I` (read and quantization noise, shot noise).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseModel {
    /// Variance without light.
    pub read: f32,
    /// Variance per unit of intensity.
    pub gain: f32,
    /// The least intensity that the sensor's code can tell, where single pixels are measured: darker ones become it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub darkest: Option<f32>,
}

/// Standard deviations of noise above the darkest intensity from where on it is not clipped.
const CLEAR_OF_CLIPPING: f32 = 4.0;

/// What clipping at zero has made of means, the other way round.
static UNCLIPPED: LazyLock<Unclipped> = LazyLock::new(Unclipped::new);

/// The mean z of a standard Gaussian whose mean is m when what is below zero becomes zero, for m up to
/// [`CLEAR_OF_CLIPPING`]: a table, linear in between (steps of 1/128: within 3e-5). No less than [`Unclipped::LEAST`].
struct Unclipped([f32; Unclipped::STEPS + 2]);

impl Unclipped {
    const STEPS: usize = 512;
    const PER_UNIT: f32 = Self::STEPS as f32 / CLEAR_OF_CLIPPING;
    /// There is no light below zero, but means of eight pixels scatter below that of none: cut off at zero, what is made
    /// of them is 0.14 too large without light, in the mean; cut off here, it is off by 0.03 at most anywhere.
    const LEAST: f32 = -0.3;

    /// Solves m = z Φ(z) + φ(z) for z by Newton's method.
    fn new() -> Self {
        Self(std::array::from_fn(|i| {
            let m = i as f64 / f64::from(Self::PER_UNIT);
            let mut z = m;
            for _ in 0..8 {
                let [part, density] = gaussian(z);
                z -= (z * part + density - m) / part.max(0.1);
            }
            (z as f32).max(Self::LEAST)
        }))
    }

    /// Returns the mean z.
    fn at(&self, m: f32) -> f32 {
        let t = (m * Self::PER_UNIT).clamp(0.0, Self::STEPS as f32);
        let (i, part) = (t as usize, t.fract());
        self.0[i] + part * (self.0[i + 1] - self.0[i])
    }
}

/// Returns Φ(z), the part of a standard Gaussian below z, and φ(z), its density there.
fn gaussian(z: f64) -> [f64; 2] {
    [0.5 * (1.0 + within_sigmas(z.abs()).copysign(z)), (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt()]
}

impl NoiseModel {
    /// Returns the noise of the mean of `n` pixels.
    pub fn of_mean(self, n: usize) -> Self {
        // What is clipped before a mean is taken of it does not follow the noise of the mean.
        let darkest = self.darkest.filter(|_| n == 1);
        Self { read: self.read / n as f32, gain: self.gain / n as f32, darkest }
    }

    /// Returns the intensity whose measurements have this mean when noise that falls below the darkest intensity is
    /// clipped; at least the darkest less 0.3 σ, which may be below zero, since means scatter. The mean of max(d,
    /// N(μ, σ²)) is d + (μ − d) Φ(z) + σ φ(z) with z = (μ − d)/σ: without light and with a black level of zero, 0.4 σ.
    pub fn unclipped(&self, mean: f32) -> f32 {
        let sigma = self.read.sqrt();
        let Some(darkest) = self.darkest.filter(|d| mean < d + CLEAR_OF_CLIPPING * sigma) else { return mean };
        darkest + sigma * UNCLIPPED.at((mean - darkest) / sigma)
    }

    /// Returns the variance of an intensity.
    pub fn variance(&self, intensity: f32) -> f32 {
        self.read + self.gain * intensity.max(0.0)
    }

    /// Returns the variance of the normalized intensity `L = (pattern − black) / (white − black)` at contrast `white −
    /// black`, by first-order propagation.
    pub fn normalized_variance(&self, l: f32, contrast: f32, black: f32) -> f32 {
        let pattern = self.variance(black + l * contrast);
        let white = self.variance(black + contrast);
        let dark = self.variance(black);
        (pattern + l * l * white + (1.0 - l) * (1.0 - l) * dark) / (contrast * contrast)
    }

    /// Returns by how much noise of white and black moves the mean of a normalized intensity `l`, measured at contrast
    /// `white − black` with a black image or without (`has_black`): (l σ²_white − (1 − l) σ²_black) / contrast², by
    /// second-order propagation.
    pub fn normalized_bias(&self, l: f32, contrast: f32, black: f32, has_black: bool) -> f32 {
        let dark = if has_black { self.variance(black) } else { 0.0 };
        (l * self.variance(black + contrast) - (1.0 - l) * dark) / (contrast * contrast)
    }

    /// Returns whether the light is too weak for `channels` channels together to tell anything at this contrast `white −
    /// black`: a shadow, the background, or too short an exposure. The variance of a codeword in mid range decides, so
    /// that a dark codeword is not mistaken for weak light.
    pub fn is_underexposed(&self, contrast: f32, black: f32, channels: f32) -> bool {
        let most = (MAX_SIGMA * channels.sqrt()).min(MAX_SIGMA_OF_MANY);
        contrast <= 0.0 || self.normalized_variance(0.5, contrast, black) > most * most
    }
}

/// The largest standard deviation of the normalized intensity, over the root of the number of channels, that still tells
/// something: 0.12 of three channels.
const MAX_SIGMA: f32 = 0.07;
/// The largest one however many channels there are.
const MAX_SIGMA_OF_MANY: f32 = 0.24;

/// Number of intensity levels.
const LEVELS: usize = 24;
/// Number of buckets of a histogram.
const BUCKETS: usize = 512;
/// Number of pixels in the rows that are looked at, about: levels need some hundreds of responses each.
const ENOUGH: usize = 500_000;
/// Number of pixels in the rows of all images that are looked at, about.
const ENOUGH_IN_ALL: usize = 5_000_000;
/// Number of classes of roughness, each 1.6 times the one before.
const CLASSES: usize = 24;

/// The responses of a level of intensity, by the roughness of their neighborhoods: histograms of |high-pass| on a
/// logarithmic scale.
type Histograms = [[u32; BUCKETS]; CLASSES];

/// Gathers noise statistics over many images; see [`NoiseEstimator::finish`].
#[derive(Clone)]
pub struct NoiseEstimator {
    /// Per intensity level.
    histograms: Vec<Histograms>,
    /// Per intensity level, sum of intensities and their number.
    intensity: Vec<(f64, u64)>,
}

impl Default for NoiseEstimator {
    fn default() -> Self {
        Self { histograms: vec![[[0; BUCKETS]; CLASSES]; LEVELS], intensity: vec![(0.0, 0); LEVELS] }
    }
}

/// Estimates the noise from one scene alone, where no sweep is at hand: from its white image and three of its patterns.
/// `lsb` is the sensor's [`quantization_step`].
pub fn estimate_scene_noise(white: &Image, patterns: &[Image], lsb: f32) -> NoiseModel {
    let mut estimator = NoiseEstimator::default();
    [white].into_iter().chain(patterns.iter().take(3)).for_each(|image| estimator.add(image));
    estimator.finish(lsb, None)
}

/// Returns the bucket of an absolute high-pass response: logarithmic, from 1e-6 to 1.
fn bucket(r: f32) -> usize {
    let t = (r.max(1e-6).log10() + 6.0) / 6.0;
    ((t * BUCKETS as f32) as usize).min(BUCKETS - 1)
}

/// Returns the roughness of a neighborhood of 3 × 3 pixels: root mean square of its first and second derivatives, each
/// scaled to the standard deviation of a pixel's noise. Independent of the high-pass response where there is noise alone.
fn roughness(v: &[f32; 9]) -> f32 {
    let column = |x: usize| v[x] + v[x + 3] + v[x + 6];
    let row = |y: usize| v[3 * y] + v[3 * y + 1] + v[3 * y + 2];
    let (dx, dy) = (column(2) - column(0), row(2) - row(0));
    let (dxx, dyy) = (column(0) - 2.0 * column(1) + column(2), row(0) - 2.0 * row(1) + row(2));
    let dxy = v[0] - v[2] - v[6] + v[8];
    (((dx * dx + dy * dy) / 6.0 + (dxx * dxx + dyy * dyy) / 18.0 + dxy * dxy / 4.0) / 5.0).sqrt()
}

/// Roughness of the upper end of the first class, and the ratio of each class's to the one's before.
const FIRST_CLASS: f32 = 2e-5;
const CLASS_RATIO: f32 = 1.6;

/// Returns the class of a roughness.
fn class(roughness: f32) -> usize {
    let t = (roughness / FIRST_CLASS).max(1e-6).log(CLASS_RATIO).ceil();
    (t.max(0.0) as usize).min(CLASSES - 1)
}

impl NoiseEstimator {
    /// Adds an image. Each pixel's response to the mask [1 −2 1; −2 4 −2; 1 −2 1] (blind to any quadratic surface;
    /// Immerkær 1996) goes to its intensity level; neighborhoods with a clipped pixel are skipped.
    pub fn add(&mut self, image: &Image) {
        self.add_one_of(1, image);
    }

    /// Adds an image like [`Self::add`], of `n` images that are added alike: of many, fewer rows of each are enough.
    pub fn add_one_of(&mut self, n: usize, image: &Image) {
        let (w, h, k) = (image.width, image.height, image.channels);
        // Every other row: neighboring rows' responses share two thirds of their pixels. Of large images fewer are enough.
        let step = (w * h / ENOUGH).max(w * h * n / ENOUGH_IN_ALL).max(2);
        for y in (1..h.saturating_sub(1)).step_by(step) {
            for x in 1..w.saturating_sub(1) {
                for c in 0..k {
                    let at = |dx: usize, dy: usize| image.data[((y + dy - 1) * w + x + dx - 1) * k + c];
                    let v = [at(0, 0), at(1, 0), at(2, 0), at(0, 1), at(1, 1), at(2, 1), at(0, 2), at(1, 2), at(2, 2)];
                    let mean = v.iter().sum::<f32>() / 9.0;
                    if v.iter().any(|v| *v >= 1.0) || mean < 0.0 {
                        continue;
                    }
                    let r = v[0] - 2.0 * v[1] + v[2] - 2.0 * v[3] + 4.0 * v[4] - 2.0 * v[5] + v[6] - 2.0 * v[7] + v[8];
                    let level = ((mean.sqrt() * LEVELS as f32) as usize).min(LEVELS - 1);
                    self.histograms[level][class(roughness(&v))][bucket(r.abs())] += 1;
                    self.intensity[level].0 += f64::from(mean);
                    self.intensity[level].1 += 1;
                }
            }
        }
    }

    /// Joins another estimator's statistics.
    pub fn merge(&mut self, other: &Self) {
        for (a, b) in self.histograms.iter_mut().zip(&other.histograms) {
            a.as_flattened_mut().iter_mut().zip(b.as_flattened()).for_each(|(a, b)| *a += b);
        }
        for (a, b) in self.intensity.iter_mut().zip(&other.intensity) {
            a.0 += b.0;
            a.1 += b.1;
        }
    }

    /// Returns how many times its variance in the dark (a ninth to a third of the scale) the noise has in bright places
    /// (beyond three fifths); `None` where one of them is hardly there, or has nothing but edges. No sensor's light is
    /// less noisy where there is more of it: below 1, something has bent the codes.
    pub fn growth(&self, lsb: f32) -> Option<f64> {
        /// Levels of the dark and of bright places: between (l / 24)² and ((l + 1) / 24)².
        const DARK: std::ops::Range<usize> = 8..14;
        const BRIGHT: std::ops::Range<usize> = 19..23;
        /// Fewest responses of a level, and of a range.
        const MIN_RESPONSES: u64 = 400;
        const MIN_IN_RANGE: u64 = 1000;
        let floor = f64::from(lsb * lsb) / 12.0;
        // Intensities between black and white may be nothing but edges of stripes, whose response would pass for noise.
        let typical = |levels: std::ops::Range<usize>| {
            let of = levels.filter_map(|l| flattest(&self.histograms[l], MIN_RESPONSES));
            let (sum, n) = of.fold((0.0, 0), |(s, n), (v, m)| (s + v.max(floor).ln() * m as f64, n + m));
            (n >= MIN_IN_RANGE).then(|| (sum / n as f64).exp())
        };
        Some(typical(BRIGHT)? / typical(DARK)?)
    }

    /// Fits the model. A level's σ is the mean of its smallest 80 % of responses, scaled to a Gaussian, which edges in
    /// the picture cannot reach. Never below what quantization with step `lsb` alone gives. Of a sensor's own pixels
    /// `darkest` is the least intensity that its code can tell: what is dark has less noise than there is, since what
    /// falls below is clipped (a third of its variance without light and with a black level of zero).
    pub fn finish(&self, lsb: f32, darkest: Option<f32>) -> NoiseModel {
        let floor = f64::from(lsb * lsb) / 12.0;
        // Weighted least squares of variance against intensity; variance estimates have errors proportional to
        // themselves.
        let (mut s, mut sx, mut sxx, mut sy, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (h, (sum, n)) in self.histograms.iter().zip(&self.intensity) {
            if *n < 400 {
                continue;
            }
            let (mean, var) = (sum / *n as f64, variance(&sum_of(h), *n));
            let (x, var) = match darkest.map(f64::from) {
                Some(darkest) if var > floor => {
                    let [above, var] = before_clipping([mean - darkest, var]);
                    (darkest + above, var)
                }
                _ => (mean, var.max(floor)),
            };
            let weight = (*n as f64).sqrt() / (var * var);
            s += weight;
            sx += weight * x;
            sxx += weight * x * x;
            sy += weight * var;
            sxy += weight * x * var;
        }
        if s == 0.0 {
            return NoiseModel { read: floor as f32, gain: 1e-4, darkest };
        }
        let det = s * sxx - sx * sx;
        let (mut read, mut gain) =
            if det > 1e-9 * s * sxx { ((sxx * sy - sx * sxy) / det, (s * sxy - sx * sy) / det) } else { (sy / s, 0.0) };
        if gain < 0.0 {
            (read, gain) = (sy / s, 0.0);
        }
        if read < floor {
            read = floor;
            gain = ((sxy - read * sx) / sxx).max(0.0);
        }
        NoiseModel { read: read as f32, gain: gain as f32, darkest }
    }
}

/// Returns mean, not negative, and variance that a Gaussian had before what is below zero became zero, from those that
/// it has since. With z = mean / σ, the mean is then σ (z Φ(z) + φ(z)) and the mean square σ² ((z² + 1) Φ(z) + z φ(z)),
/// and their ratio grows with z.
fn before_clipping([mean, variance]: [f64; 2]) -> [f64; 2] {
    let clipped = |z: f64| {
        let [part, density] = gaussian(z);
        let mean = z * part + density;
        [mean, (z * z + 1.0) * part + z * density - mean * mean]
    };
    let ratio = |[mean, variance]: [f64; 2]| mean / variance.sqrt();
    let (mut low, mut high) = (0.0, f64::from(CLEAR_OF_CLIPPING));
    if ratio([mean, variance]) >= high {
        return [mean, variance];
    }
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if ratio(clipped(middle)) < ratio([mean, variance]) { low = middle } else { high = middle }
    }
    let variance = variance / clipped(low)[1];
    [low * variance.sqrt(), variance]
}

/// Returns the variance of noise in a level's flattest tenth, and the number of responses in it, at least `min`; `None`
/// where even that tenth is rougher than its noise, or has too few responses.
fn flattest(histograms: &Histograms, min: u64) -> Option<(f64, u64)> {
    let count = |h: &[u32; BUCKETS]| h.iter().map(|c| u64::from(*c)).sum::<u64>();
    let wanted = min.max(histograms.iter().map(count).sum::<u64>() / 10);
    let mut n = 0;
    let last = histograms.iter().position(|h| {
        n += count(h);
        n >= wanted
    })?;
    let variance = variance(&sum_of(&histograms[..=last]), n);
    let roughest = f64::from(FIRST_CLASS) * f64::from(CLASS_RATIO).powi(last as i32);
    // The end of a class is up to 1.6 times as rough as what is in it.
    (last == 0 || roughest * roughest <= 2.6 * variance).then_some((variance, n))
}

fn sum_of(histograms: &[[u32; BUCKETS]]) -> [u32; BUCKETS] {
    let mut sum = [0; BUCKETS];
    histograms.iter().for_each(|h| sum.iter_mut().zip(h).for_each(|(a, b)| *a += b));
    sum
}

/// Returns the variance of a level from the smallest 80 % of its `n` responses.
fn variance(histogram: &[u32; BUCKETS], n: u64) -> f64 {
    // Mean of |z| below its 80 % quantile for a standard Gaussian, and the gain of the mask.
    const TRIMMED: f64 = 0.5587;
    const MASK: f64 = 6.0;
    let used = (n as f64 * 0.8) as u64;
    let (mut counted, mut total) = (0u64, 0.0);
    for (i, c) in histogram.iter().enumerate() {
        let take = u64::from(*c).min(used - counted);
        total += take as f64 * 10f64.powf((i as f64 + 0.5) / BUCKETS as f64 * 6.0 - 6.0);
        counted += take;
    }
    (total / used as f64 / TRIMMED / MASK).powi(2)
}

/// Returns one step of the sensor's code in linear intensity, for a camera with these levels.
pub fn quantization_step(black_level: f64, saturation: f64) -> f32 {
    (1.0 / (saturation - black_level).max(1e-9)) as f32
}

/// Returns the linear intensity of the sensor's least code, for a camera with these levels: 0 or less.
pub fn darkest_intensity(black_level: f64, saturation: f64) -> f32 {
    (-black_level / (saturation - black_level).max(1e-9)) as f32
}
