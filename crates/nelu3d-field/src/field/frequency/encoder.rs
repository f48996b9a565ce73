//! Points to network inputs, by frequencies.

use super::super::encoder::Encoder;
use super::config::{FrequencyFieldConfig, MAX_OCTAVES};
use crate::encoding::frequency::{self, Frequency};
use crate::mlp::cpu::BLOCK;

/// Frequencies before a network.
pub(super) struct FrequencyEncoder {
    /// As many octaves as the axis that has most.
    encoding: Frequency,
    /// Octaves of each axis.
    n_frequencies: [usize; 3],
}

impl FrequencyEncoder {
    /// Makes the encoder of a field.
    pub(super) fn new(config: &FrequencyFieldConfig) -> Self {
        let n_frequencies = config.n_frequencies.map(|n| n.min(MAX_OCTAVES));
        let encoding = Frequency { n_frequencies: n_frequencies.into_iter().max().unwrap_or(0) };
        Self { encoding, n_frequencies }
    }
}

impl Encoder<3> for FrequencyEncoder {
    /// Features of all axes with as many octaves as the one that has most.
    type Scratch = Vec<f32>;

    fn scratch(&self, _: usize) -> Vec<f32> {
        vec![0.0; BLOCK * self.encoding.n_features(3)]
    }

    #[inline(always)]
    fn encode(&self, points: &[[f32; 3]], all: &mut Vec<f32>, x: &mut [f32], stride: usize) {
        let n = self.encoding.n_features(3);
        frequency::cpu::forward(self.encoding, points, &mut all[..points.len() * n]);
        for (i, (point, x)) in points.iter().zip(x.chunks_exact_mut(stride)).enumerate() {
            let mut column = 0;
            for (axis, octaves) in self.n_frequencies.iter().enumerate() {
                let from = i * n + 2 * axis * self.encoding.n_frequencies;
                x[column..column + 2 * octaves].copy_from_slice(&all[from..from + 2 * octaves]);
                column += 2 * octaves;
            }
            x[column..column + 3].copy_from_slice(point);
        }
    }

    /// Frequencies have no parameters: nothing needs the gradients.
    #[inline(always)]
    fn collect(&self, _: usize, _: usize, _: &[f32], _: usize, _: &mut Vec<f32>) {}
}
