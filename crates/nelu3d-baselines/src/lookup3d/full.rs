//! A lookup table that holds every sample of a sweep.

use rayon::prelude::*;

use super::shape::TableShape;

/// Every sample of a sweep.
#[derive(Clone, Debug)]
pub struct FullTable {
    /// The sizes.
    pub shape: TableShape,
    /// Variance that the sensor's noise gives a well-lit entry; 0 when it is not known (a table from a file).
    pub variance: f32,
    /// `[pixel][channel, then depth][position]`, positions padded with NaN to whole vectors.
    pub(super) data: Vec<f32>,
}

impl FullTable {
    /// A table of missing samples.
    pub fn empty(shape: TableShape) -> Self {
        Self { shape, variance: 0.0, data: vec![f32::NAN; shape.n_pixels() * shape.row_len()] }
    }

    /// Sets a sample: k channels (all of them or none is a number) and the depth of the board's plane, mm.
    ///
    /// # Panics
    /// If `sample` does not hold k + 1 values.
    pub fn set(&mut self, pixel: usize, position: usize, sample: &[f32]) {
        let TableShape { k, .. } = self.shape;
        let (stride, row_len) = (self.shape.stride(), self.shape.row_len());
        assert!(sample.len() == k + 1 && position < self.shape.n_positions);
        let row = &mut self.data[pixel * row_len..][..row_len];
        // With a channel or the depth missing nothing can be found there.
        let missing = sample.iter().any(|v| !v.is_finite());
        for (j, v) in sample.iter().enumerate() {
            row[j * stride + position] = if missing && j < k || !v.is_finite() { f32::NAN } else { *v };
        }
    }

    /// Sets a position's samples of the pixels from `first` on, `[pixel][k + 1]`.
    pub(crate) fn set_column(&mut self, position: usize, first: usize, samples: &[f32]) {
        for (i, sample) in samples.chunks_exact(self.shape.k + 1).enumerate() {
            self.set(first + i, position, sample);
        }
    }

    /// Sets one value of a sample as it comes from a file; [`Self::close`] must follow.
    pub(crate) fn put(&mut self, pixel: usize, j: usize, position: usize, value: f32) {
        let at = pixel * self.shape.row_len() + j * self.shape.stride() + position;
        self.data[at] = if value.is_finite() { value } else { f32::NAN };
    }

    /// Makes samples missing as a whole that lack a channel or have no depth in front of the camera.
    pub(crate) fn close(&mut self) {
        let (k, stride, row_len) = (self.shape.k, self.shape.stride(), self.shape.row_len());
        self.data.par_chunks_exact_mut(row_len).for_each(|row| {
            for p in 0..stride {
                if row[k * stride + p] <= 0.0 {
                    row[k * stride + p] = f32::NAN;
                }
                if (0..=k).any(|j| row[j * stride + p].is_nan()) {
                    (0..k).for_each(|j| row[j * stride + p] = f32::NAN);
                }
            }
        });
    }

    /// Values of a pixel, `[channel, then depth][position]`, each [`TableShape::stride`] long.
    #[inline]
    pub(crate) fn row(&self, pixel: usize) -> &[f32] {
        &self.data[pixel * self.shape.row_len()..][..self.shape.row_len()]
    }

    /// Values of channel `j` (k: the depth) of a pixel, position by position.
    pub fn channel(&self, pixel: usize, j: usize) -> &[f32] {
        &self.data[pixel * self.shape.row_len() + j * self.shape.stride()..][..self.shape.n_positions]
    }
}
