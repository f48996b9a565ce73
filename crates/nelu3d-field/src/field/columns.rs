//! Layouts of network inputs and of their gradients.

use crate::encoding::hash_grid::HashGrid;

/// The derivative of what a network sees of a point, 2x − 1, by the point.
pub(crate) const POSITION_SLOPE: f32 = 2.0;

/// Writes points x of the unit cube into the network's inputs after their features, as 2x − 1.
#[inline(always)]
pub(crate) fn append_positions<const D: usize>(points: &[[f32; D]], x: &mut [f32], stride: usize, column: usize) {
    for (point, x) in points.iter().zip(x.chunks_exact_mut(stride)) {
        x[column..column + D].copy_from_slice(&point.map(|p| POSITION_SLOPE * p - 1.0));
    }
}

/// A transposition: rows of features by point become `[level][point][feature]`, so that each level's owner reads only
/// its own.
pub(crate) struct Columns<'a> {
    out: &'a mut [f32],
    n_points: usize,
    n_levels: usize,
    n_features: usize,
}

impl<'a> Columns<'a> {
    /// Prepares the transposition of `n_points` points into `out`.
    pub(crate) fn new<const D: usize>(grid: &HashGrid<D>, out: &'a mut [f32], n_points: usize) -> Self {
        Self { out, n_points, n_levels: grid.levels().len(), n_features: grid.config().n_features_per_level }
    }

    /// Writes the rows of points from `first` on.
    #[inline(always)]
    pub(crate) fn write(&mut self, first: usize, rows: &[f32], stride: usize) {
        match self.n_features {
            1 => self.write_features::<1>(first, rows, stride),
            2 => self.write_features::<2>(first, rows, stride),
            4 => self.write_features::<4>(first, rows, stride),
            _ => self.write_features::<8>(first, rows, stride),
        }
    }

    #[inline(always)]
    fn write_features<const F: usize>(&mut self, first: usize, rows: &[f32], stride: usize) {
        let n = rows.len() / stride;
        let (out, _) = self.out.as_chunks_mut::<F>();
        for l in 0..self.n_levels {
            let out = &mut out[l * self.n_points + first..][..n];
            for (out, row) in out.iter_mut().zip(rows.chunks_exact(stride)) {
                out.copy_from_slice(&row[l * F..][..F]);
            }
        }
    }
}
