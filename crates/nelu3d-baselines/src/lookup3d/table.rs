//! The table in memory.

use nelu3d_field::nearest::{self, Codes, Hit, LANES};
use rayon::prelude::*;

use super::LowRank;

/// Sizes of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Pixels of a row of the table: `camera width / step`, rounded up.
    pub width: usize,
    /// Rows: `camera height / step`, rounded up.
    pub height: usize,
    /// Which of the camera's pixels it holds: every `step`th, from the first.
    pub step: usize,
    /// Board positions P.
    pub n_positions: usize,
    /// Channels of a codeword.
    pub k: usize,
}

impl Shape {
    /// Of a table for every `step`th pixel of a picture of `width × height`.
    pub fn of_picture(width: usize, height: usize, step: usize, n_positions: usize, k: usize) -> Self {
        Self { width: width.div_ceil(step), height: height.div_ceil(step), step, n_positions, k }
    }

    /// Pixels.
    pub fn n_pixels(&self) -> usize {
        self.width * self.height
    }

    /// Positions in memory.
    pub(crate) fn stride(&self) -> usize {
        self.n_positions.next_multiple_of(LANES)
    }

    /// Values of a pixel in memory: k channels and the depth.
    pub(crate) fn row_len(&self) -> usize {
        (self.k + 1) * self.stride()
    }

    pub(crate) fn for_kernel(&self) -> nearest::Shape {
        nearest::Shape { n_channels: self.k, n_positions: self.n_positions, stride: self.stride() }
    }
}

/// Every sample of a sweep.
#[derive(Clone, Debug)]
pub struct FullTable {
    /// Its sizes.
    pub shape: Shape,
    /// Variance that the sensor's noise gives a well-lit entry; 0 when it is not known (a table from a file).
    pub variance: f32,
    /// `[pixel][channel, then depth][position]`, positions padded with NaN to whole vectors.
    data: Vec<f32>,
}

impl FullTable {
    /// A table of missing samples.
    pub fn empty(shape: Shape) -> Self {
        Self { shape, variance: 0.0, data: vec![f32::NAN; shape.n_pixels() * shape.row_len()] }
    }

    /// Sets a sample: k channels (all of them or none is a number) and the depth of the board's plane, mm.
    ///
    /// # Panics
    /// If `sample` does not hold k + 1 values.
    pub fn set(&mut self, pixel: usize, position: usize, sample: &[f32]) {
        let Shape { k, .. } = self.shape;
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

    /// Values of a pixel, `[channel, then depth][position]`, each [`Shape::stride`] long.
    #[inline]
    pub(crate) fn row(&self, pixel: usize) -> &[f32] {
        &self.data[pixel * self.shape.row_len()..][..self.shape.row_len()]
    }

    /// Values of channel `j` (k: the depth) of a pixel, position by position.
    pub fn channel(&self, pixel: usize, j: usize) -> &[f32] {
        &self.data[pixel * self.shape.row_len() + j * self.shape.stride()..][..self.shape.n_positions]
    }
}

/// A lookup table, whole or compressed.
#[derive(Clone, Debug)]
pub enum Table {
    /// Every sample.
    Full(FullTable),
    /// Products of factors.
    LowRank(LowRank),
}

impl Table {
    /// Its sizes.
    pub fn shape(&self) -> &Shape {
        match self {
            Table::Full(t) => &t.shape,
            Table::LowRank(t) => &t.shape,
        }
    }

    /// Variance that the sensor's noise gives a well-lit entry; 0 when it is not known.
    pub fn variance(&self) -> f32 {
        match self {
            Table::Full(t) => t.variance,
            Table::LowRank(t) => t.variance,
        }
    }

    /// Memory of its entries.
    pub fn bytes(&self) -> usize {
        match self {
            Table::Full(t) => size_of_val(&t.data[..]),
            Table::LowRank(t) => t.bytes(),
        }
    }

    /// A pixel's sample at a position into `out`: k channels and depth. `false`, and nothing written, if it is missing.
    #[inline]
    pub fn sample(&self, pixel: usize, position: usize, out: &mut [f32]) -> bool {
        match self {
            Table::Full(t) => {
                let stride = t.shape.stride();
                let row = t.row(pixel);
                let there = !row[position].is_nan();
                if there {
                    out.iter_mut().enumerate().for_each(|(j, o)| *o = row[j * stride + position]);
                }
                there
            }
            Table::LowRank(t) => t.sample(pixel, position, out),
        }
    }

    /// A pixel's depth at a position, mm; NaN if that sample is missing.
    #[inline]
    pub fn depth(&self, pixel: usize, position: usize) -> f32 {
        match self {
            Table::Full(t) => {
                let row = t.row(pixel);
                if row[position].is_nan() { f32::NAN } else { row[t.shape.k * t.shape.stride() + position] }
            }
            Table::LowRank(t) => t.depth(pixel, position),
        }
    }

    /// The closest positions for the pixels from `first` on; see [`nearest::cpu::nearest`].
    pub(crate) fn nearest(&self, first: usize, queries: &[f32], ranges: Option<&[[u32; 2]]>, hits: &mut [Hit]) {
        let shape = self.shape().for_kernel();
        match self {
            Table::Full(t) => {
                let row_len = t.shape.row_len();
                let data = &t.data[first * row_len..][..hits.len() * row_len];
                nearest::cpu::nearest(shape, Codes::Full { data, row_len }, queries, ranges, hits);
            }
            Table::LowRank(t) => t.nearest(first, queries, ranges, hits),
        }
    }
}
