//! Intensities of an image whose means are those of the light, and what their noise is judged by.

use std::borrow::Cow;

use nelu3d_scan::Image;
use rayon::prelude::*;

use super::noise::NoiseModel;

/// Standard deviations of noise by which a pixel may differ from the mean around it.
const ALIKE: f32 = 4.0;

/// The intensities of an image, `height × width × channels`.
#[derive(Clone, Debug)]
pub struct Intensities {
    /// As measured, without what clipping in the dark adds to their means ([`NoiseModel::unclipped`]).
    pub own: Vec<f32>,
    /// The means of the eight pixels around each; its own where the two differ by more than noise: at an edge, on a fine
    /// stripe, in a texture.
    ///
    /// It is what a weight has to be made from. A variance that follows a pixel's own noise gives more weight to what
    /// noise has made dark, or has divided by a white that it made bright, and all weighted means come out too dark: by
    /// about three parts in a thousand where white is a thousand electrons.
    pub mean: Vec<f32>,
}

impl Intensities {
    /// Takes the intensities of an image with this noise.
    pub fn new(image: &Image, noise: &NoiseModel) -> Self {
        let row = (image.width * image.channels).max(1);
        let (mut own, mut mean) = (image.data.clone(), vec![0.0; image.data.len()]);
        let rows = own.par_chunks_mut(row).zip(mean.par_chunks_mut(row)).enumerate();
        rows.for_each_init(
            || vec![0.0; row],
            |columns, (y, (own, mean))| {
                means_of_row(image, y, noise, columns, mean);
                if noise.darkest.is_some() {
                    for (own, mean) in own.iter_mut().zip(mean) {
                        let unclipped = noise.unclipped(*mean);
                        *own += unclipped - *mean;
                        *mean = unclipped;
                    }
                }
            },
        );
        Self { own, mean }
    }

    /// Returns [`Self::own`] alone, of the values for which `wanted` is above zero; of the others, what was measured.
    pub fn own_where<'a>(image: &'a Image, noise: &NoiseModel, wanted: &[f32]) -> Cow<'a, [f32]> {
        if noise.darkest.is_none() {
            return Cow::Borrowed(&image.data);
        }
        let row = (image.width * image.channels).max(1);
        let mut own = image.data.clone();
        own.par_chunks_mut(row).zip(wanted.par_chunks(row)).enumerate().for_each_init(
            || [vec![0.0; row], vec![0.0; row]],
            |[columns, mean], (y, (own, wanted))| {
                if wanted.iter().any(|w| *w > 0.0) {
                    means_of_row(image, y, noise, columns, mean);
                    for ((own, mean), _) in own.iter_mut().zip(mean).zip(wanted).filter(|(_, w)| **w > 0.0) {
                        *own += noise.unclipped(*mean) - *mean;
                    }
                }
            },
        );
        Cow::Owned(own)
    }
}

/// Writes what [`Intensities::mean`] is, clipping apart, of a row of an image to `mean`; `columns` is as long.
fn means_of_row(image: &Image, y: usize, noise: &NoiseModel, columns: &mut [f32], mean: &mut [f32]) {
    sum_columns(image, y, columns);
    let n_rows = 1 + usize::from(y > 0) + usize::from(y + 1 < image.height);
    let own = &image.data[y * columns.len()..][..columns.len()];
    mean_of_others(columns, own, image.channels, n_rows, mean);
    keep_edges(own, noise, mean);
}

/// Writes the sums of a row of an image and of its neighbors to `sums`.
fn sum_columns(image: &Image, y: usize, sums: &mut [f32]) {
    let row = |y: usize| &image.data[y * sums.len()..(y + 1) * sums.len()];
    let (own, above, below) = (row(y), row(y.saturating_sub(1)), row((y + 1).min(image.height - 1)));
    let (has_above, has_below) = (f32::from(y > 0), f32::from(y + 1 < image.height));
    for (((sum, own), above), below) in sums.iter_mut().zip(own).zip(above).zip(below) {
        *sum = own + has_above * above + has_below * below;
    }
}

/// Writes the means of the eight pixels around each of a row, fewer at the border, to `mean`; `columns` has the sums of
/// `n_rows` rows.
fn mean_of_others(columns: &[f32], own: &[f32], channels: usize, n_rows: usize, mean: &mut [f32]) {
    let n = own.len();
    let others = |columns: usize| 1.0 / ((n_rows * columns - 1).max(1)) as f32;
    if n <= 2 * channels {
        // One or two pixels.
        let pixels = n / channels;
        for i in 0..n {
            let sum: f32 = columns.iter().skip(i % channels).step_by(channels).sum();
            mean[i] = if n_rows * pixels > 1 { (sum - own[i]) * others(pixels) } else { own[i] };
        }
        return;
    }
    let part = others(3);
    let inner = &mut mean[channels..n - channels];
    for ((((mean, own), left), here), right) in
        inner.iter_mut().zip(&own[channels..]).zip(columns).zip(&columns[channels..]).zip(&columns[2 * channels..])
    {
        *mean = (left + here + right - own) * part;
    }
    let part = others(2);
    for c in 0..channels {
        let last = n - channels + c;
        mean[c] = (columns[c] + columns[channels + c] - own[c]) * part;
        mean[last] = (columns[last - channels] + columns[last] - own[last]) * part;
    }
}

/// Writes a pixel's own intensity to `mean` where the two differ by more than noise.
fn keep_edges(own: &[f32], noise: &NoiseModel, mean: &mut [f32]) {
    for (mean, own) in mean.iter_mut().zip(own) {
        let difference = own - *mean;
        let is_alike = difference * difference <= ALIKE * ALIKE * noise.variance(*mean);
        *mean = if is_alike { *mean } else { *own };
    }
}
