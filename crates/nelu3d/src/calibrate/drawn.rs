//! What a sweep is judged by: samples that are drawn from every position while its images are read for the first time,
//! and hashes of these, so that they need not be read once more when the field is known.

use super::judge::Fingerprint;
use super::sweep::Position;

/// Most positions that are judged.
pub const MAX_POSITIONS: usize = 64;
/// About how many samples are drawn from all positions.
const SAMPLES_IN_ALL: usize = 200_000;
/// The fewest and the most samples that are drawn from one position.
pub const SAMPLES: std::ops::RangeInclusive<usize> = 4_000..=12_000;

/// Returns the indices of the positions that are judged, of `n`: all of them, or an even selection with both ends.
pub fn selection(n: usize) -> Vec<usize> {
    match n {
        ..=MAX_POSITIONS => (0..n).collect(),
        _ => (0..MAX_POSITIONS).map(|i| i * (n - 1) / (MAX_POSITIONS - 1)).collect(),
    }
}

/// What is kept of a position.
#[derive(Clone)]
pub struct Drawn {
    /// Hash of its images.
    pub(super) fingerprint: Fingerprint,
    /// Contrast from which a sample is well lit.
    pub(super) lit: f32,
    k: usize,
    channels: usize,
    /// Indices of pixels.
    pub pixels: Vec<usize>,
    /// Normalized intensities, `[sample][k]`.
    pub values: Vec<f32>,
    /// White − black, `[sample][channel]`.
    pub contrast: Vec<f32>,
    /// Contrast (white − black) of what is bright around a sample, and the variance of its codeword that edges of ink
    /// leave open, `[sample]`.
    pub around_and_edge: Vec<[f32; 2]>,
    /// Gradient of the logarithm of the contrast along x and y, per sample of the image, `[sample]`.
    gradients: Vec<[f32; 2]>,
}

/// A sample that was drawn.
pub(super) struct DrawnSample<'a> {
    /// Index of its pixel.
    pub(super) pixel: usize,
    /// Normalized intensities.
    pub(super) values: &'a [f32],
    /// White − black per channel; 0 where it cannot be used.
    pub(super) contrast: &'a [f32],
    /// White − black of what is bright around it.
    pub(super) around: f32,
    /// Variance of its values that edges of ink beside it leave open.
    pub(super) edge: f32,
    /// Gradient of the logarithm of the contrast along x and y, per sample of the image.
    pub(super) gradient: [f32; 2],
}

impl Drawn {
    /// Draws samples that are usable from a position, one of `n_positions`.
    pub fn of(position: &Position, fingerprint: Fingerprint, lit: f32, n_positions: usize) -> Self {
        let (k, channels, n) = (position.k, position.channels, position.around.len());
        let samples = (SAMPLES_IN_ALL / n_positions.max(1)).clamp(*SAMPLES.start(), *SAMPLES.end());
        let every = (n / samples).max(1) as u64;
        // A share of the pixels, in no pattern that a print could share.
        let is_drawn = |i: &usize| ((*i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40).is_multiple_of(every);
        let contrast = |i: usize| &position.contrast[i * channels..][..channels];
        let pixels: Vec<usize> = (0..n).filter(is_drawn).filter(|i| position.is_usable(*i)).collect();
        Self {
            fingerprint,
            lit,
            k,
            channels,
            values: pixels.iter().flat_map(|i| &position.values[i * k..][..k]).copied().collect(),
            contrast: pixels.iter().flat_map(|i| contrast(*i)).copied().collect(),
            around_and_edge: pixels.iter().map(|i| [position.around[*i], position.edge[*i]]).collect(),
            gradients: pixels.iter().map(|i| position.log_gradient(*i)).collect(),
            pixels,
        }
    }

    /// Returns the samples.
    pub(super) fn samples(&self) -> impl Iterator<Item = DrawnSample<'_>> {
        self.pixels.iter().copied().zip(&self.around_and_edge).enumerate().map(|(number, (pixel, [around, edge]))| {
            let values = &self.values[number * self.k..][..self.k];
            let contrast = &self.contrast[number * self.channels..][..self.channels];
            let gradient = self.gradients[number];
            DrawnSample { pixel, values, contrast, around: *around, edge: *edge, gradient }
        })
    }
}
