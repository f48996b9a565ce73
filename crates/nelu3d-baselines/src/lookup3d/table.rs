//! A lookup table in memory, full or low-rank.

use nelu3d_field::nearest::{self, Codes, Hit};

use super::full::FullTable;
use super::low_rank::LowRank;
use super::shape::TableShape;

/// A lookup table, whole or compressed.
#[derive(Clone, Debug)]
pub enum Table {
    /// Every sample.
    Full(FullTable),
    /// Products of factors.
    LowRank(LowRank),
}

impl Table {
    /// Returns the sizes.
    pub fn shape(&self) -> &TableShape {
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
