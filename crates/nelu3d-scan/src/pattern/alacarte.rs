//! Patterns à la carte: optimized so that zero-mean normalized cross-correlation (ZNCC) decodes them with the fewest
//! errors (Mirdehghan, Chen and Kutulakos, "Optimal Structured Light à la Carte", CVPR 2018).

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::axis::{Axis, along};
use super::error::PatternError;
use super::noise::SplitMix;
use crate::image::Image;

/// `count` images without frequencies above a cap, optimized for decoding by ZNCC.
///
/// What is minimized is a soft form of the paper's expected number of correspondence errors (the indicator of the
/// decoded column becomes a softmax of ZNCC scores over all columns): for a column p seen with normal noise, the
/// softmax's fraction on columns further than `tolerance_px` from p. Columns and noise are drawn anew in every
/// iteration; Adam follows the exact gradient. Where this differs from the paper: the frequency cap is kept by
/// construction (a pattern is a sum of waves below the cap) and not by a penalty, and every column of the light source
/// is a candidate for every pixel, as the geometry is not known here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct Alacarte {
    /// Direction of change.
    #[cfg_attr(feature = "clap", arg(skip))]
    pub axis: Axis,
    /// Number of images.
    #[cfg_attr(feature = "clap", arg(long, value_name = "K", default_value_t = 4))]
    pub count: usize,
    /// Highest frequency, periods across the image.
    #[cfg_attr(feature = "clap", arg(long, value_name = "CYCLES", default_value_t = 16.0))]
    pub max_frequency: f64,
    /// Columns on either side that are decoded together with a pixel's own; 0 for pixels on their own.
    #[cfg_attr(feature = "clap", arg(long, value_name = "PX", default_value_t = 0))]
    pub neighbors: usize,
    /// Noise to optimize for: standard deviation of a normalized intensity.
    #[cfg_attr(feature = "clap", arg(long, value_name = "SIGMA", default_value_t = 0.02))]
    pub noise: f64,
    /// Errors up to this count as none, px.
    #[cfg_attr(feature = "clap", arg(long = "tolerance", value_name = "PX", default_value_t = 2))]
    pub tolerance_px: usize,
    /// Steps of the optimization.
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 800))]
    pub iterations: usize,
    /// Seed; the same seed gives the same patterns.
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 0))]
    pub seed: u64,
}

impl Default for Alacarte {
    fn default() -> Self {
        Self {
            axis: Axis::X,
            count: 4,
            max_frequency: 16.0,
            neighbors: 0,
            noise: 0.02,
            tolerance_px: 2,
            iterations: 800,
            seed: 0,
        }
    }
}

/// Columns drawn in an iteration.
const BATCH: usize = 96;
/// The waves' frequencies are multiples of one period over this many widths: more than one, or the pattern's two ends
/// would look alike.
const STRETCH: f64 = 1.25;
/// Most columns to optimize over.
const MAX_COLUMNS: usize = 2048;
const LEARNING_RATE: f64 = 0.02;

impl Alacarte {
    pub(super) fn generate(&self, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
        let n = self.axis.length(width, height);
        self.check(n)?;
        let lines = self.optimize(n);
        Ok(lines.iter().map(|line| along(self.axis, width, height, |u| line[u])).collect())
    }

    fn check(&self, n: usize) -> Result<(), PatternError> {
        let wrong = |key, value, remedy| Err(PatternError::Setting { family: "alacarte", key, value, remedy });
        if !(3..=32).contains(&self.count) {
            return wrong("count", self.count as f64, "give 3 to 32 images: ZNCC of fewer values is ±1");
        }
        if !(1.0..=1024.0).contains(&self.max_frequency) || (n > 3 && self.max_frequency > n as f64 / 2.0) {
            return wrong("max_frequency", self.max_frequency, "give 1 to half the columns, at most 1024");
        }
        if self.neighbors > 16 {
            return wrong("neighbors", self.neighbors as f64, "give at most 16");
        }
        if !(1e-4..=1.0).contains(&self.noise) {
            return wrong("noise", self.noise, "give 0.0001 to 1");
        }
        if self.iterations > 100_000 {
            return wrong("iterations", self.iterations as f64, "give at most 100,000");
        }
        Ok(())
    }

    /// Optimizes the patterns' lines, `count × n`: the best of several starts after a short run, then the long run from
    /// there.
    fn optimize(&self, n: usize) -> Vec<Vec<f64>> {
        let mut random = SplitMix(self.seed);
        // Waves are smooth: more columns than these would only take longer.
        let m = n.min(MAX_COLUMNS);
        let tolerance = (self.tolerance_px * m).div_ceil(n);
        let mut best: Option<(f64, Waves)> = None;
        let keep_better = |best: &mut Option<(f64, Waves)>, waves: Waves| {
            let wrong = self.wrong(&waves, tolerance);
            if best.as_ref().is_none_or(|b| wrong < b.0) {
                *best = Some((wrong, waves));
            }
        };
        let starts = [Start::Turn, Start::Noise, Start::Noise].into_iter().chain([Start::Mix; 8]);
        for start in starts {
            let mut waves = Waves::new(m, self.count, self.max_frequency);
            waves.start(start, &mut random);
            self.descend(&mut waves, tolerance, self.iterations / 10, 0.0, &mut random);
            keep_better(&mut best, waves);
        }
        let mut waves = best.as_ref().expect("several starts").1.clone();
        self.descend(&mut waves, tolerance, self.iterations, 0.25, &mut random);
        keep_better(&mut best, waves);
        let (_, waves) = best.expect("several starts");
        if m == n { waves.lines } else { waves.at(n, self.count, self.max_frequency).lines }
    }

    fn descend(&self, waves: &mut Waves, tolerance: usize, iterations: usize, from: f64, random: &mut SplitMix) {
        let mut adam = Adam::new(waves.coefficients.len());
        for i in 0..iterations {
            let progress = from + (1.0 - from) * i as f64 / iterations as f64;
            let words = Windows::new(&waves.lines, waves.n, self.count, self.neighbors);
            // Soft at first, so that far confusions are felt; at the end as sharp as the noise is small.
            let sharpness = 20.0 * (words.sharpest(self.noise) / 20.0).max(1.0).powf(progress);
            let (_, gradient) = words.gradient(self.noise, tolerance, sharpness, random);
            let gradient = waves.project(&gradient);
            let rate = LEARNING_RATE * 0.5 * (1.0 + (std::f64::consts::PI * progress).cos());
            adam.step(&mut waves.coefficients, &gradient, rate);
            waves.update();
        }
    }

    /// Returns the expected fraction of wrong columns, with the same noise at every call.
    fn wrong(&self, waves: &Waves, tolerance: usize) -> f64 {
        let words = Windows::new(&waves.lines, waves.n, self.count, self.neighbors);
        let mut random = SplitMix(!self.seed);
        let sharpness = words.sharpest(self.noise);
        (0..8).map(|_| words.gradient(self.noise, tolerance, sharpness, &mut random).0).sum::<f64>() / 8.0
    }
}

/// Returns the expected fraction of columns that zero-mean normalized cross-correlation decodes wrongly, in the soft
/// form that [`Alacarte`] minimizes, and its gradient with respect to the codewords, column by column (`n × count`).
///
/// `lines` are the patterns, `count × n` values in `[0, 1]`. A column is seen together with `neighbors` columns on
/// either side, with normal noise of standard deviation `noise`; columns up to `tolerance_px` away count as right;
/// `sharpness` is the factor of the scores in the softmax. `seed` draws the columns and their noise: the same seed, the
/// same draws.
///
/// # Panics
///
/// If there are no patterns, or they differ in length.
pub fn expected_zncc_error(
    lines: &[Vec<f64>],
    neighbors: usize,
    noise: f64,
    tolerance_px: usize,
    sharpness: f64,
    seed: u64,
) -> (f64, Vec<f64>) {
    let n = lines[0].len();
    assert!(lines.iter().all(|line| line.len() == n), "patterns of one length");
    Windows::new(lines, n, lines.len(), neighbors).gradient(noise, tolerance_px, sharpness, &mut SplitMix(seed))
}

/// Where an optimization starts.
#[derive(Clone, Copy)]
enum Start {
    /// One slow period, shifted from image to image: unambiguous, a circle in code space.
    Turn,
    /// One wave of any frequency below the cap an image: what micro phase shifting is made of.
    Mix,
    /// All waves at once.
    Noise,
}

/// Patterns as sums of waves below a cap.
#[derive(Clone)]
struct Waves {
    n: usize,
    /// Cosine and sine of every frequency at every column, `waves × n`.
    basis: Vec<Vec<f64>>,
    /// `count × waves`.
    coefficients: Vec<f64>,
    /// The patterns, each stretched to [0, 1]: `count × n`.
    lines: Vec<Vec<f64>>,
}

impl Waves {
    /// Starts without waves: all coefficients are zero.
    fn new(n: usize, count: usize, max_frequency: f64) -> Self {
        let highest = ((max_frequency * STRETCH).floor() as usize).max(1);
        let phase = |f: usize, u: usize| TAU * f as f64 * u as f64 / (STRETCH * n as f64);
        let basis: Vec<Vec<f64>> = (1..=highest)
            .flat_map(|f| {
                let cosines = (0..n).map(|u| phase(f, u).cos()).collect();
                let sines = (0..n).map(|u| phase(f, u).sin()).collect();
                [cosines, sines]
            })
            .collect();
        let coefficients = vec![0.0; count * basis.len()];
        Self { n, basis, coefficients, lines: vec![vec![0.0; n]; count] }
    }

    fn start(&mut self, start: Start, random: &mut SplitMix) {
        let m = self.basis.len();
        let count = self.lines.len();
        for (j, of_image) in self.coefficients.chunks_exact_mut(m).enumerate() {
            let turn = j as f64 / count as f64;
            let (frequency, phase) = match start {
                Start::Turn => (0, turn),
                _ => ((random.uniform() * (m / 2) as f64) as usize, random.uniform()),
            };
            // A little of everything, so that nothing has a gradient of exactly zero.
            of_image.iter_mut().for_each(|c| *c = 0.02 * random.normal());
            match start {
                Start::Noise => of_image.iter_mut().for_each(|c| *c = random.normal()),
                Start::Turn | Start::Mix => {
                    of_image[2 * frequency] = (TAU * phase).cos();
                    of_image[2 * frequency + 1] = (TAU * phase).sin();
                }
            }
        }
        self.update();
    }

    /// Returns these waves over `n` columns.
    fn at(&self, n: usize, count: usize, max_frequency: f64) -> Self {
        let mut waves = Self::new(n, count, max_frequency);
        waves.coefficients.clone_from(&self.coefficients);
        waves.update();
        waves
    }

    /// Evaluates the patterns and scales their coefficients so that each spans [0, 1]. ZNCC does not mind an offset
    /// common to all patterns, but the light source cannot show anything else.
    fn update(&mut self) {
        let m = self.basis.len();
        self.lines = self
            .coefficients
            .chunks_exact_mut(m)
            .map(|coefficients| {
                let mut line = vec![0.0; self.n];
                for (c, row) in coefficients.iter().zip(&self.basis) {
                    line.iter_mut().zip(row).for_each(|(v, b)| *v += c * b);
                }
                let (min, max) = line.iter().fold((f64::MAX, f64::MIN), |(a, b), &v| (a.min(v), b.max(v)));
                let scale = 1.0 / (max - min).max(1e-9);
                coefficients.iter_mut().for_each(|c| *c *= scale);
                line.iter_mut().for_each(|v| *v = (*v - min) * scale);
                line
            })
            .collect();
    }

    /// Returns the gradient of the coefficients from that of the codewords, `n × count`.
    fn project(&self, gradient: &[f64]) -> Vec<f64> {
        let count = self.lines.len();
        let mut out = Vec::with_capacity(self.coefficients.len());
        for j in 0..count {
            let column: Vec<f64> = gradient.iter().skip(j).step_by(count).copied().collect();
            out.extend(self.basis.iter().map(|row| row.iter().zip(&column).map(|(b, g)| b * g).sum::<f64>()));
        }
        out
    }
}

/// Codewords with those of their neighbors, as ZNCC sees them.
struct Windows {
    n: usize,
    count: usize,
    reach: usize,
    /// Values of a word.
    d: usize,
    /// `n × d`.
    raw: Vec<f32>,
    /// The words of `raw`, zero-mean and of length 1.
    unit: Vec<f32>,
    /// Their lengths before that, n.
    length: Vec<f32>,
}

impl Windows {
    fn new(lines: &[Vec<f64>], n: usize, count: usize, reach: usize) -> Self {
        let d = count * (2 * reach + 1);
        let raw: Vec<f32> = (0..n)
            .flat_map(|u| {
                (0..=2 * reach).flat_map(move |o| {
                    let at = neighbor(u, o, reach, n);
                    lines.iter().map(move |line| line[at] as f32)
                })
            })
            .collect();
        let mut unit = raw.clone();
        let length = unit.chunks_exact_mut(d).map(center_and_scale).collect();
        Self { n, count, reach, d, raw, unit, length }
    }

    /// Returns the factor of the scores at which the softmax is the posterior of the columns: a word of length l seen
    /// with noise σ has the likelihood exp(l² ZNCC / σ²), but for a factor. Here for the words' mean square length.
    fn sharpest(&self, noise: f64) -> f64 {
        self.length.iter().map(|&l| f64::from(l * l)).sum::<f64>() / self.n as f64 / (noise * noise)
    }

    /// Returns the expected fraction of wrong columns and its gradient with respect to the codewords, `n × count`.
    fn gradient(&self, noise: f64, tolerance: usize, sharpness: f64, random: &mut SplitMix) -> (f64, Vec<f64>) {
        let mut wrong_sum = 0.0;
        let across: Vec<Vec<f32>> =
            (0..self.d).map(|j| self.unit.iter().skip(j).step_by(self.d).copied().collect()).collect();
        let (n, d) = (self.n, self.d);
        let mut of_unit = vec![0.0_f32; n * d];
        let mut out = vec![0.0; n * self.count];
        let mut scores = vec![0.0_f32; n];
        let mut seen = vec![0.0_f32; d];
        let mut of_seen = vec![0.0_f32; d];
        for b in 0..BATCH {
            // One of every stretch of columns: less variance than independent draws.
            let p = (((b as f64 + random.uniform()) / BATCH as f64 * n as f64) as usize).min(n - 1);
            for (s, &w) in seen.iter_mut().zip(&self.raw[p * d..(p + 1) * d]) {
                *s = (f64::from(w) + noise * random.normal()) as f32;
            }
            let length = center_and_scale(&mut seen);
            if length == 0.0 {
                continue;
            }
            scores.fill(0.0);
            for (row, &value) in across.iter().zip(&seen) {
                scores.iter_mut().zip(row).for_each(|(s, w)| *s += w * value);
            }
            let most = scores.iter().copied().fold(f32::MIN, f32::max);
            let mut total = 0.0;
            for s in &mut scores {
                let exponent = (*s - most) * sharpness as f32;
                *s = if exponent > -25.0 { exponent.exp() } else { 0.0 };
                total += *s;
            }
            let near = p.saturating_sub(tolerance)..(p + tolerance + 1).min(n);
            let right = scores[near.clone()].iter().sum::<f32>() / total;
            let wrong = 1.0 - right;
            wrong_sum += f64::from(wrong);
            // d(wrong)/d(score_q) = sharpness · softmax_q · (1 if q is wrong, else 0, − wrong).
            of_seen.fill(0.0);
            for q in 0..n {
                if scores[q] == 0.0 {
                    continue;
                }
                let share = scores[q] / total;
                let g = share * sharpness as f32 * (if near.contains(&q) { 0.0 } else { 1.0 } - wrong);
                let word = &self.unit[q * d..(q + 1) * d];
                for j in 0..d {
                    of_unit[q * d + j] += g * seen[j];
                    of_seen[j] += g * word[j];
                }
            }
            through_scale(&mut of_seen, &seen, length);
            self.scatter(p, &of_seen, &mut out);
        }
        for q in 0..n {
            let g = &mut of_unit[q * d..(q + 1) * d];
            if self.length[q] > 0.0 {
                through_scale(g, &self.unit[q * d..(q + 1) * d], self.length[q]);
                self.scatter(q, g, &mut out);
            }
        }
        out.iter_mut().for_each(|g| *g /= BATCH as f64);
        (wrong_sum / BATCH as f64, out)
    }

    /// Adds a word's gradient to the columns its values came from.
    fn scatter(&self, u: usize, gradient: &[f32], out: &mut [f64]) {
        for (o, part) in gradient.chunks_exact(self.count).enumerate() {
            let at = neighbor(u, o, self.reach, self.n);
            let to = &mut out[at * self.count..(at + 1) * self.count];
            to.iter_mut().zip(part).for_each(|(t, &g)| *t += f64::from(g));
        }
    }
}

/// Returns the `o`-th of the columns from `u − reach` to `u + reach`, those beyond the ends replaced by the last.
fn neighbor(u: usize, o: usize, reach: usize, n: usize) -> usize {
    (u + o).saturating_sub(reach).min(n - 1)
}

/// Makes a word zero-mean and of length 1; returns its length before, 0 if it is constant.
fn center_and_scale(word: &mut [f32]) -> f32 {
    let mean = word.iter().sum::<f32>() / word.len() as f32;
    word.iter_mut().for_each(|v| *v -= mean);
    let length = word.iter().map(|v| v * v).sum::<f32>().sqrt();
    if length < 1e-6 {
        word.fill(0.0);
        return 0.0;
    }
    word.iter_mut().for_each(|v| *v /= length);
    length
}

/// Returns the gradient of what [`center_and_scale`] was given from that of what it made (`unit`).
fn through_scale(gradient: &mut [f32], unit: &[f32], length: f32) {
    let along: f32 = gradient.iter().zip(unit).map(|(g, u)| g * u).sum();
    gradient.iter_mut().zip(unit).for_each(|(g, u)| *g = (*g - along * u) / length);
    let mean = gradient.iter().sum::<f32>() / gradient.len() as f32;
    gradient.iter_mut().for_each(|g| *g -= mean);
}

/// Adam (Kingma and Ba 2015), β = (0.9, 0.99).
struct Adam {
    first: Vec<f64>,
    second: Vec<f64>,
    steps: i32,
}

impl Adam {
    fn new(n: usize) -> Self {
        Self { first: vec![0.0; n], second: vec![0.0; n], steps: 0 }
    }

    fn step(&mut self, x: &mut [f64], gradient: &[f64], rate: f64) {
        self.steps += 1;
        let corrections = (1.0 - 0.9_f64.powi(self.steps), 1.0 - 0.99_f64.powi(self.steps));
        // A step relative to the size of a typical coefficient.
        let size = (x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64).sqrt();
        for (((x, g), m), v) in x.iter_mut().zip(gradient).zip(&mut self.first).zip(&mut self.second) {
            *m = 0.9 * *m + 0.1 * g;
            *v = 0.99 * *v + 0.01 * g * g;
            *x -= rate * size * (*m / corrections.0) / ((*v / corrections.1).sqrt() + 1e-12);
        }
    }
}
