//! The codes of all columns: what a set of images shows along its axis.

use super::axis::Axis;
use crate::image::Image;

/// How an image changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stripes {
    /// It is constant.
    Constant,
    /// It changes along one axis only.
    Along(Axis),
    /// It changes along both axes.
    Both,
}

impl Stripes {
    /// Tells how an image changes whose values may differ by `tolerance` without being different.
    pub fn of(image: &Image, tolerance: f32) -> Self {
        let (w, c) = (image.width, image.channels);
        let differ = |a: f32, b: f32| (a - b).abs() > tolerance;
        let first_row = &image.data[..w * c];
        let y = image.data.chunks_exact(w * c).any(|row| row.iter().zip(first_row).any(|(&a, &b)| differ(a, b)));
        let x = image.data.chunks_exact(w * c).any(|row| (c..w * c).any(|i| differ(row[i], row[i % c])));
        match (x, y) {
            (false, false) => Stripes::Constant,
            (true, false) => Stripes::Along(Axis::X),
            (false, true) => Stripes::Along(Axis::Y),
            (true, true) => Stripes::Both,
        }
    }
}

/// One codeword a column (or row): the images' values there.
#[derive(Clone, Debug, PartialEq)]
pub struct Codewords {
    /// Values of a codeword.
    pub k: usize,
    /// `columns × k` values in `[0, 1]`, column by column.
    pub data: Vec<f32>,
}

impl Codewords {
    /// Makes codewords from a table of `columns × k`.
    ///
    /// # Panics
    ///
    /// If `k` is 0 or does not divide the table's length.
    pub fn new(k: usize, data: Vec<f32>) -> Self {
        assert!(k > 0 && data.len().is_multiple_of(k), "codewords of {k} values in a table of {}", data.len());
        Self { k, data }
    }

    /// Returns the codewords of images that change along `axis`: each image's mean over the other direction, its
    /// channels one after the other. Images of one size.
    ///
    /// # Panics
    ///
    /// If there are no images, or of different sizes.
    pub fn of_images(images: &[Image], axis: Axis) -> Self {
        assert!(!images.is_empty(), "codewords of no image");
        let (w, h) = (images[0].width, images[0].height);
        assert!(images.iter().all(|i| (i.width, i.height) == (w, h)), "images of one size");
        let (n, across) = if axis == Axis::X { (w, h) } else { (h, w) };
        let k: usize = images.iter().map(|i| i.channels).sum();
        let mut data = Vec::with_capacity(n * k);
        for u in 0..n {
            for image in images {
                for c in 0..image.channels {
                    let at = |v: usize| if axis == Axis::X { image.pixel(u, v)[c] } else { image.pixel(v, u)[c] };
                    data.push(((0..across).map(|v| f64::from(at(v))).sum::<f64>() / across as f64) as f32);
                }
            }
        }
        Self { k, data }
    }

    /// Returns the number of columns.
    pub fn len(&self) -> usize {
        self.data.len() / self.k
    }

    /// Returns whether there are no columns.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// Returns the codeword of column `u`, k values.
    pub fn word(&self, u: usize) -> &[f32] {
        &self.data[u * self.k..(u + 1) * self.k]
    }

    /// Returns the column whose codeword is nearest to a pixel's normalized intensities, and their Euclidean distance;
    /// the first of several. `None` where a value is not finite, or there are no columns.
    ///
    /// # Panics
    ///
    /// If there are more or fewer values than a codeword has.
    pub fn nearest(&self, values: &[f32]) -> Option<(usize, f32)> {
        assert_eq!(values.len(), self.k, "one value per image");
        let squared = |word: &[f32]| word.iter().zip(values).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
        let (u, least) = self.data.chunks_exact(self.k).map(squared).enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
        least.is_finite().then(|| (u, least.sqrt()))
    }

    /// Returns the codewords less their mean and scaled to length 1, so that their dot product is the zero-mean
    /// normalized cross-correlation (ZNCC). Constant codewords become zeros.
    pub fn normalized(&self) -> Self {
        let mut data = self.data.clone();
        data.chunks_exact_mut(self.k).for_each(normalize);
        Self { k: self.k, data }
    }
}

/// Subtracts a word's mean and scales it to length 1; a constant word becomes zeros.
pub(super) fn normalize(word: &mut [f32]) {
    let mean = word.iter().sum::<f32>() / word.len() as f32;
    word.iter_mut().for_each(|v| *v -= mean);
    let length = word.iter().map(|v| v * v).sum::<f32>().sqrt();
    let scale = if length > 1e-6 { 1.0 / length } else { 0.0 };
    word.iter_mut().for_each(|v| *v *= scale);
}
