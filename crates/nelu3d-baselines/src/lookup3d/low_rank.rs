//! A table as products of factors, decoded without ever being multiplied out.

use nelu3d_field::nearest::{self, Codes, Hit};

use super::shape::TableShape;

/// Per channel (and for the depth) two factors: entry = Σ_i left_i(pixel) · right_i(position).
#[derive(Clone, Debug, PartialEq)]
pub struct LowRank {
    /// Sizes of the table they stand for.
    pub shape: TableShape,
    /// Variance that the sensor's noise gives a well-lit entry; 0 when it is not known.
    pub variance: f32,
    /// Terms of a channel's sum.
    pub rank: usize,
    /// Terms of the depth's sum.
    pub depth_rank: usize,
    /// `[pixel][k · rank, then depth_rank]`
    pub(super) left: Vec<f32>,
    /// `[channel][rank][position, padded with 0]`
    pub(super) right: Vec<f32>,
    /// `[depth_rank][position]`
    pub(super) right_depth: Vec<f32>,
    /// Per pixel the first position that has a sample, and the one after the last.
    pub(super) ranges: Vec<[u32; 2]>,
}

impl LowRank {
    /// All factors zero, every sample present.
    pub(crate) fn zeros(shape: TableShape, rank: usize, depth_rank: usize) -> Self {
        let n = shape.n_pixels();
        Self {
            shape,
            variance: 0.0,
            rank,
            depth_rank,
            left: vec![0.0; n * (shape.k * rank + depth_rank)],
            right: vec![0.0; shape.k * rank * shape.stride()],
            right_depth: vec![0.0; depth_rank * shape.n_positions],
            ranges: vec![[0, shape.n_positions as u32]; n],
        }
    }

    /// Values of a pixel in `left`.
    pub(crate) fn row_len(&self) -> usize {
        self.shape.k * self.rank + self.depth_rank
    }

    /// Memory of the factors.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.left[..])
            + size_of_val(&self.right[..])
            + size_of_val(&self.right_depth[..])
            + size_of_val(&self.ranges[..])
    }

    fn holds(&self, pixel: usize, position: usize) -> bool {
        (self.ranges[pixel][0]..self.ranges[pixel][1]).contains(&(position as u32))
    }

    pub(crate) fn sample(&self, pixel: usize, position: usize, out: &mut [f32]) -> bool {
        if !self.holds(pixel, position) {
            return false;
        }
        for (j, out) in out[..self.shape.k].iter_mut().enumerate() {
            *out = self.entry(pixel, j, position);
        }
        out[self.shape.k] = self.depth(pixel, position);
        true
    }

    /// Channel `j` of a sample that is held.
    fn entry(&self, pixel: usize, j: usize, position: usize) -> f32 {
        let (r, stride) = (self.rank, self.shape.stride());
        let left = &self.left[pixel * self.row_len() + j * r..][..r];
        let right = &self.right[j * r * stride..][..r * stride];
        left.iter().enumerate().map(|(i, l)| l * right[i * stride + position]).sum()
    }

    /// Channel `j` (k: the depth) at a position; NaN if that sample is missing.
    pub(crate) fn value(&self, pixel: usize, j: usize, position: usize) -> f32 {
        if j == self.shape.k {
            self.depth(pixel, position)
        } else if self.holds(pixel, position) {
            self.entry(pixel, j, position)
        } else {
            f32::NAN
        }
    }

    pub(crate) fn depth(&self, pixel: usize, position: usize) -> f32 {
        if !self.holds(pixel, position) {
            return f32::NAN;
        }
        let left = &self.left[pixel * self.row_len() + self.shape.k * self.rank..][..self.depth_rank];
        let right = self.right_depth.chunks_exact(self.shape.n_positions);
        left.iter().zip(right).map(|(l, right)| l * right[position]).sum()
    }

    pub(crate) fn nearest(&self, first: usize, queries: &[f32], ranges: Option<&[[u32; 2]]>, hits: &mut [Hit]) {
        let held = &self.ranges[first..][..hits.len()];
        // What is asked for, of what there is.
        let ranges: Vec<[u32; 2]> = match ranges {
            None => held.to_vec(),
            Some(asked) => held.iter().zip(asked).map(|(h, a)| [h[0].max(a[0]), h[1].min(a[1])]).collect(),
        };
        let row_len = self.row_len();
        let left = &self.left[first * row_len..][..hits.len() * row_len];
        let codes = Codes::LowRank { left, row_len, right: &self.right, rank: self.rank };
        nearest::cpu::nearest(self.shape.for_kernel(), codes, queries, Some(&ranges), hits);
    }
}
