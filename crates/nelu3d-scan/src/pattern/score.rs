//! How well a code tells its columns apart: its confusion statistics, from the codewords alone.

use rayon::prelude::*;
use serde::Serialize;

use super::codewords::{Codewords, normalize};
use super::noise::SplitMix;

/// What to ask of a code.
#[derive(Clone, Debug, PartialEq)]
pub struct ScoreOptions {
    /// Columns count as far apart beyond each of these distances, px.
    pub distances_px: Vec<usize>,
    /// Standard deviation of the noise of a normalized intensity.
    pub sigma: f64,
    /// Noisy pixels decoded for each column.
    pub samples: usize,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for ScoreOptions {
    fn default() -> Self {
        Self { distances_px: vec![2, 10, 50], sigma: 0.02, samples: 16, seed: 0 }
    }
}

/// A code's confusion statistics.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Number of columns (or rows).
    pub columns: usize,
    /// Values of a codeword.
    pub values: usize,
    /// How fast the codeword changes, |dc/du| per px.
    pub sensitivity: Sensitivity,
    /// How near far columns come to each other in code space, for each distance asked for.
    pub separations: Vec<Separation>,
    /// Noise assumed, standard deviation of a normalized intensity.
    pub sigma: f64,
    /// Decoding noisy pixels to the nearest codeword.
    pub nearest: DecodingErrors,
    /// Decoding noisy pixels to the codeword of highest ZNCC; none for codewords of one or two values, whose ZNCC is
    /// ±1.
    pub zncc: Option<DecodingErrors>,
}

/// |dc/du| over the columns, intensity per px.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Sensitivity {
    /// Its median.
    pub median: f64,
    /// Its minimum.
    pub min: f64,
    /// Standard deviation of a column that the noise makes where the code has its median sensitivity, px; not finite
    /// for a code of steps.
    pub sigma_px: f64,
}

/// Code distances of columns more than `beyond_px` apart.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Separation {
    /// How far apart columns must be to count, px.
    pub beyond_px: usize,
    /// Smallest Euclidean distance of two codewords.
    pub euclidean: f64,
    /// The two columns of that distance.
    pub columns: [usize; 2],
    /// Smallest 1 − ZNCC of two codewords, `[0, 2]`; none where ZNCC is ±1.
    pub zncc: Option<f64>,
    /// Fraction of columns that have another one, so far away, within four standard deviations of the noise: a pixel
    /// halfway between both is two from each, so that 2 % of pixels are taken for the other.
    pub within_noise: f64,
}

/// Errors of decoded columns, px.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DecodingErrors {
    /// Mean of the absolute error.
    pub mean_px: f64,
    /// Median of the absolute error.
    pub median_px: f64,
    /// Root mean square.
    pub rms_px: f64,
    /// Fraction of pixels decoded more than each distance asked for away.
    pub beyond: Vec<f64>,
}

/// Computes the confusion statistics of a code. Time grows with the square of the columns.
///
/// The expected decoding errors are averages over `samples` pixels a column with independent normal noise, the same for
/// the same seed.
///
/// # Panics
///
/// If there are fewer than two codewords.
pub fn score(words: &Codewords, options: &ScoreOptions) -> Score {
    let n = words.len();
    assert!(n > 1, "a code of {n} columns");
    let normalized = (words.k > 2).then(|| words.normalized());
    let euclidean = smallest(words, &options.distances_px);
    let zncc = normalized.as_ref().map(|w| smallest(w, &options.distances_px));
    let separations = options.distances_px.iter().enumerate().map(|(d, &beyond_px)| {
        let (least, u, v) = euclidean
            .iter()
            .enumerate()
            .map(|(u, to)| (to[d].0, u, to[d].1))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .expect("columns");
        let within = euclidean.iter().filter(|to| f64::from(to[d].0.sqrt()) < 4.0 * options.sigma).count();
        Separation {
            beyond_px,
            euclidean: f64::from(least.sqrt()),
            columns: [u.min(v), u.max(v)],
            // |a − b|² = 2 (1 − a·b) of vectors of length 1.
            zncc: zncc.as_ref().map(|z| z.iter().map(|to| 0.5 * f64::from(to[d].0)).fold(f64::INFINITY, f64::min)),
            within_noise: within as f64 / n as f64,
        }
    });
    Score {
        columns: n,
        values: words.k,
        sensitivity: sensitivity(words, options.sigma),
        separations: separations.collect(),
        sigma: options.sigma,
        nearest: decoding_errors(words, None, options),
        zncc: normalized.as_ref().map(|z| decoding_errors(words, Some(z), options)),
    }
}

/// Returns the squared code distance of every two columns, `columns × columns`, thinned to at most `side` of either by
/// keeping the smallest of each block, so that no confusion is lost. Returns the side and the values.
pub fn confusion_matrix(words: &Codewords, side: usize) -> (usize, Vec<f32>) {
    let n = words.len();
    let block = n.div_ceil(side.max(1)).max(1);
    let m = n.div_ceil(block);
    let rows = (0..m).into_par_iter().flat_map_iter(|i| {
        let mut row = vec![f32::INFINITY; m];
        for u in i * block..((i + 1) * block).min(n) {
            for v in 0..n {
                let least = &mut row[v / block];
                *least = least.min(squared(words.word(u), words.word(v)));
            }
        }
        row
    });
    (m, rows.collect())
}

fn squared(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Returns for every column and distance the smallest squared code distance to a column further away, and that column.
/// Infinite where no column is so far.
fn smallest(words: &Codewords, distances_px: &[usize]) -> Vec<Vec<(f32, usize)>> {
    let n = words.len();
    (0..n)
        .into_par_iter()
        .map(|u| {
            // left[v]: the smallest of columns 0..v; right[v]: of columns v..n.
            let near = |a: (f32, usize), b: (f32, usize)| if b.0 < a.0 { b } else { a };
            let none = (f32::INFINITY, u);
            let row: Vec<(f32, usize)> = (0..n).map(|v| (squared(words.word(u), words.word(v)), v)).collect();
            let running = |least: &mut (f32, usize), x: &(f32, usize)| {
                *least = near(*least, *x);
                Some(*least)
            };
            let left: Vec<_> = std::iter::once(none).chain(row.iter().scan(none, running)).collect();
            let right: Vec<_> = std::iter::once(none).chain(row.iter().rev().scan(none, running)).collect();
            distances_px
                .iter()
                .map(|&d| {
                    near(left[u.saturating_sub(d)], right[n.saturating_sub(u.saturating_add(d).saturating_add(1))])
                })
                .collect()
        })
        .collect()
}

fn sensitivity(words: &Codewords, sigma: f64) -> Sensitivity {
    let n = words.len();
    let mut slopes: Vec<f64> = (0..n)
        .map(|u| {
            let (a, b) = (u.saturating_sub(1), (u + 1).min(n - 1));
            f64::from(squared(words.word(a), words.word(b)).sqrt()) / (b - a) as f64
        })
        .collect();
    slopes.sort_by(f64::total_cmp);
    Sensitivity { median: slopes[n / 2], min: slopes[0], sigma_px: sigma / slopes[n / 2] }
}

/// Returns the errors of noisy pixels decoded by distance, or by ZNCC where `normalized` words are given.
fn decoding_errors(words: &Codewords, normalized: Option<&Codewords>, options: &ScoreOptions) -> DecodingErrors {
    let n = words.len();
    let mut errors: Vec<u32> = (0..n)
        .into_par_iter()
        .flat_map_iter(|u| {
            let mut random = SplitMix(options.seed ^ (u as u64 + 1).wrapping_mul(0xd1b5_4a32_d192_ed03));
            let mut pixel = vec![0.0_f32; words.k];
            (0..options.samples)
                .map(|_| {
                    for (p, &w) in pixel.iter_mut().zip(words.word(u)) {
                        *p = (f64::from(w) + options.sigma * random.normal()) as f32;
                    }
                    let table = normalized.unwrap_or(words);
                    if normalized.is_some() {
                        normalize(&mut pixel);
                    }
                    let decoded = table.nearest(&pixel).expect("finite values").0;
                    decoded.abs_diff(u) as u32
                })
                .collect::<Vec<_>>()
        })
        .collect();
    errors.sort_unstable();
    let count = errors.len().max(1) as f64;
    let mean = |f: &dyn Fn(f64) -> f64| errors.iter().map(|&e| f(f64::from(e))).sum::<f64>() / count;
    DecodingErrors {
        mean_px: mean(&|e| e),
        median_px: errors.get(errors.len() / 2).map_or(f64::NAN, |&e| f64::from(e)),
        rms_px: mean(&|e| e * e).sqrt(),
        beyond: options.distances_px.iter().map(|&d| mean(&|e| f64::from(u8::from(e > d as f64)))).collect(),
    }
}
