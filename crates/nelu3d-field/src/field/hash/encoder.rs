//! Points to network inputs, by a hash grid.

use super::super::columns::{Columns, append_positions};
use super::super::encoder::Encoder;
use crate::encoding::hash_grid::{HashGrid, cpu as hash_grid};

/// A hash grid before a network.
pub(super) struct HashEncoder<'a, const D: usize> {
    pub(super) grid: &'a HashGrid<D>,
    pub(super) table: &'a [f32],
    /// Whether the network also sees the point x itself, as 2x − 1, after its features.
    pub(super) append: bool,
}

impl<const D: usize> Encoder<D> for HashEncoder<'_, D> {
    /// Gradients of the features, `[level][point][feature]`.
    type Scratch = Vec<f32>;

    fn scratch(&self, n_points: usize) -> Vec<f32> {
        vec![0.0; n_points * self.grid.n_features()]
    }

    #[inline(always)]
    fn encode(&self, points: &[[f32; D]], _: &mut Vec<f32>, x: &mut [f32], stride: usize) {
        hash_grid::encode_inlined(self.grid, self.table, points, 0, x, &mut [], stride);
        if self.append {
            append_positions(points, x, stride, self.grid.n_features());
        }
    }

    #[inline(always)]
    fn collect(&self, first: usize, n_points: usize, d_x: &[f32], stride: usize, d_features: &mut Vec<f32>) {
        Columns::new(self.grid, d_features, n_points).write(first, d_x, stride);
    }
}
