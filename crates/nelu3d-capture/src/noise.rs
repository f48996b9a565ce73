//! How much two pictures of the same may differ.

use std::collections::HashSet;

use crate::samples::{Samples, mean, mean_square_difference};

/// Noise of a camera's frames, measured from frames in which nothing changed: the variance of a code v is
/// `offset + slope v`, and whole blocks of the picture brighten and darken together by `flicker` of their value.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct FrameNoise {
    /// Variance of a dark pixel, codes².
    pub offset: f64,
    /// Growth of the variance with the code, codes.
    pub slope: f64,
    /// Standard deviation of a block's brightness from frame to frame, as a part of it.
    pub flicker: f64,
    /// Whether frames of the same are the same bit for bit: then a frame that was delivered twice cannot be told from
    /// two frames.
    pub none: bool,
}

/// A block differs when its mean square difference is this many times what noise makes of it. With the 64 values that
/// a block has at least, noise alone exceeds 1.9 once in 10⁶ blocks.
const DIFFERS: f64 = 3.0;
/// A block differs from one that was taken a while ago when its mean square difference is this many times what noise
/// makes of it: lamps drift.
const DIFFERS_LATER: f64 = 8.0;
/// Part of the blocks that may differ in frames of the same: something small may move.
const STRAY_BLOCKS: f64 = 0.003;
/// Smallest variance of a code, codes²: rounding (1/12) and what compression adds now and then.
const MIN_VARIANCE: f64 = 0.15;
/// Median of the square of a standard normal number.
const MEDIAN_OF_SQUARE: f64 = 0.4549;

impl FrameNoise {
    /// Measures noise from frames of one light and frames of another, each in order. Single frames that show something
    /// else do no harm.
    pub(crate) fn measure(bright: &[Samples], dark: &[Samples]) -> Self {
        // Frames that are delivered twice still leave half of them different.
        let kinds = |frames: &[Samples]| frames.iter().map(|s| s.fingerprint).collect::<HashSet<_>>().len();
        let none = 4 * (kinds(bright) + kinds(dark)) <= bright.len() + dark.len() + 4;
        if none {
            return Self { offset: MIN_VARIANCE, slope: 0.0, flicker: 0.0, none };
        }
        let dark_variances: Vec<f64> = block_variances(dark).iter().map(|(_, v)| *v).collect();
        let offset = percentile(dark_variances, 0.75).max(MIN_VARIANCE);
        let bright = block_variances(bright).into_iter().zip(block_flicker(bright));
        let (mut slopes, mut flickers) = (Vec::new(), Vec::new());
        for ((level, variance), (n, square)) in bright.filter(|((level, _), _)| *level > 1.0) {
            slopes.push(((variance - offset) / level).max(0.0));
            let of_noise = 2.0 * variance / n as f64;
            flickers.push(((square / MEDIAN_OF_SQUARE - of_noise) / (2.0 * level * level)).max(0.0));
        }
        let flicker = percentile(flickers, 0.75).sqrt();
        Self { offset, slope: percentile(slopes, 0.75), flicker, none }
    }

    /// Returns whether two frames show the same, taken one soon after the other.
    pub(crate) fn agree(&self, a: &Samples, b: &Samples) -> bool {
        self.differing(a, b, DIFFERS) <= STRAY_BLOCKS
    }

    /// Returns whether a frame shows what one showed that was taken a while ago.
    pub(crate) fn resemble(&self, a: &Samples, b: &Samples) -> bool {
        self.differing(a, b, DIFFERS_LATER) <= STRAY_BLOCKS
    }

    /// Returns the part of the blocks that differ from what a frame showed a while ago.
    pub(crate) fn changed(&self, a: &Samples, b: &Samples) -> f64 {
        self.differing(a, b, DIFFERS_LATER)
    }

    fn differing(&self, a: &Samples, b: &Samples, times: f64) -> f64 {
        let differs = |(a, b): (&[f32], &[f32])| {
            let level = 0.5 * (mean(a) + mean(b)).max(0.0);
            let expected = 2.0 * (self.offset + self.slope * level + (self.flicker * level).powi(2));
            mean_square_difference(a, b) > times * expected
        };
        let all: Vec<bool> = a.pairs(b).map(differs).collect();
        all.iter().filter(|d| **d).count() as f64 / all.len().max(1) as f64
    }
}

/// Returns each block's mean and the variance of its values, from differences of consecutive frames: the median over
/// the frames.
fn block_variances(frames: &[Samples]) -> Vec<(f64, f64)> {
    let pairs = distinct(frames);
    let Some((first, _)) = pairs.first() else { return Vec::new() };
    let mut found: Vec<Vec<(f64, f64)>> = vec![Vec::new(); first.pairs(first).count()];
    for (a, b) in &pairs {
        for (block, (a, b)) in found.iter_mut().zip(a.pairs(b)) {
            block.push((mean(a), 0.5 * mean_square_difference(a, b)));
        }
    }
    let median = |block: Vec<(f64, f64)>| {
        let (levels, variances): (Vec<f64>, Vec<f64>) = block.into_iter().unzip();
        (percentile(levels, 0.5), percentile(variances, 0.5))
    };
    found.into_iter().map(median).collect()
}

/// Returns each block's number of values and the median square of its mean's changes.
fn block_flicker(frames: &[Samples]) -> Vec<(usize, f64)> {
    let pairs = distinct(frames);
    let Some((first, _)) = pairs.first() else { return Vec::new() };
    let mut found: Vec<(usize, Vec<f64>)> = first.pairs(first).map(|(a, _)| (a.len(), Vec::new())).collect();
    for (a, b) in &pairs {
        for ((_, squares), (a, b)) in found.iter_mut().zip(a.pairs(b)) {
            squares.push((mean(a) - mean(b)).powi(2));
        }
    }
    found.into_iter().map(|(n, squares)| (n, percentile(squares, 0.5))).collect()
}

/// Returns consecutive frames that are not one and the same.
fn distinct(frames: &[Samples]) -> Vec<(&Samples, &Samples)> {
    let pairs: Vec<_> = frames.windows(2).map(|w| (&w[0], &w[1])).collect();
    let differ: Vec<_> = pairs.iter().copied().filter(|(a, b)| a.fingerprint != b.fingerprint).collect();
    if differ.is_empty() { pairs } else { differ }
}

/// Returns the value below which a part of the values lies; 0 of none.
pub(crate) fn percentile(mut values: Vec<f64>, part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    values.get((part * last as f64).round() as usize).copied().unwrap_or(0.0)
}
