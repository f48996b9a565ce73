//! Samples of a tricubic B-spline in its normal equations, Bᵀ Ω B, applied without being formed: B evaluates the spline
//! at the samples, each of which is a mean over points that are spread by variances v along a and b:
//! c + ½ v_a ∂²c/∂a² + ½ v_b ∂²c/∂b². Ω are weights per sample and channel.
//!
//! A sample touches 64 nodes: 16 runs of four neighbors along w, which with their channels are 4 k consecutive numbers.
//! [`mod@reference`] is the plain form; `cpu.rs` takes 16 samples at a time: their weights side by side, then what they
//! gather from x, then their values, then what they spread over y. What is read of y and written again is shared by
//! samples of the same cell.

mod cpu;
pub mod reference;

pub use cpu::{add_product, add_spread};

use crate::bench::Demand;

/// The nodes of a spline in memory, `[b][a][w][k]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeStrides {
    /// Channels.
    pub k: usize,
    /// Values from one node to the next along b.
    pub row: usize,
    /// Values from one node to the next along a.
    pub column: usize,
}

/// Where a sample is, and how far what it stands for reaches around it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Beginning of the first of its 16 runs.
    pub base: u32,
    /// Position in its cell along a, b and w, in `[0, 1]`.
    pub position: [f32; 3],
    /// Variances of what it is the mean of, along a and b, in squared cells.
    pub spread: [f32; 2],
}

/// What is added to the nodes of a sample for each of its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weights {
    /// The weight b of the node in the sample: Bᵀ.
    Plain,
    /// Its square: a term of the diagonal of Bᵀ Ω B.
    Squared,
}

impl NodeStrides {
    /// Returns the number of values from the first of a sample's runs to the end of the last.
    fn extent(&self) -> usize {
        3 * self.row + 3 * self.column + 4 * self.k
    }

    /// Panics if there is not a value per sample and channel.
    fn check(&self, places: &[Place], values: &[f32]) {
        assert!(self.k > 0);
        assert_eq!(values.len(), places.len() * self.k);
    }
}

/// Returns what one product of `samples` samples of `k` channels asks of the machine: weights, two passes over the
/// runs, and the sample's own value; of memory its place and weights, beside `nodes` values of x and y.
pub fn demand(samples: usize, nodes: usize, k: usize) -> Demand {
    let (samples, k) = (samples as f64, k as f64);
    let flops = 3.0 * 17.0 + 2.0 * 4.0 * 5.0 + 16.0 + 2.0 * 2.0 * 64.0 * k + 13.0 * k;
    Demand { flops: samples * flops, bytes: samples * (24.0 + 4.0 * k) + 12.0 * nodes as f64, ..Demand::default() }
}
