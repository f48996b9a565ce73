//! The gradients of one training step, for all forms of a field.
//!
//! Points are cut into chunks of fixed size; a chunk sums its own network gradient, and the chunks' sums are added in
//! order, so that results do not depend on the number of threads.

use super::config::RegressionLoss;
use super::encoder::Encoder;
use crate::mlp::MlpConfig;
use crate::mlp::cpu::{self as mlp, BLOCK, MlpGradient, MlpScratch, PackedMlp, padded};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Points whose network gradients are summed before anything else: fixed, so that sums do not depend on threads.
pub(super) const CHUNK: usize = 8 * BLOCK;

/// Scratch and sums of one chunk of points.
#[derive(Clone, Debug)]
pub(super) struct Chunk<S> {
    /// Network inputs of one block, `[BLOCK][padded n_inputs]`; padding stays zero.
    x: Vec<f32>,
    /// Their gradients.
    d_x: Vec<f32>,
    /// The encoder's memory.
    pub(super) encoding: S,
    scratch: MlpScratch,
    gradient: MlpGradient,
    loss: f64,
}

/// Where the gradient of the outputs comes from.
#[derive(Clone, Copy)]
pub(super) enum Objective<'a> {
    /// The loss scale · Σ_i w_i Σ_o ρ(out_io − target_io)
    Regression { loss: RegressionLoss, weights: &'a [f32], scale: f32 },
    /// The gradient is the caller's.
    Given,
}

impl Objective<'_> {
    /// Returns the objective of `n` points from `first` on.
    fn part(self, first: usize, n: usize) -> Self {
        match self {
            Self::Regression { loss, weights, scale } if !weights.is_empty() => {
                Self::Regression { loss, weights: &weights[first..][..n], scale }
            }
            other => other,
        }
    }
}

/// A network behind an encoder.
#[derive(Clone, Copy)]
pub(super) struct Network<'a, E> {
    pub(super) encoder: &'a E,
    pub(super) mlp: &'a MlpConfig,
    pub(super) packed: &'a PackedMlp,
}

impl<E> Network<'_, E> {
    /// Computes forward, loss and backward of all points; writes the network's gradient and returns the sum of the
    /// points' losses. `per_output` has a target, or a gradient, per output. The gradients of the inputs stay in the
    /// first chunks.
    pub(super) fn gradients<const D: usize>(
        &self,
        points: &[[f32; D]],
        per_output: &[f32],
        objective: Objective<'_>,
        chunks: &mut Vec<Chunk<E::Scratch>>,
        network_gradient: &mut [f32],
    ) -> f64
    where
        E: Encoder<D>,
    {
        let Self { encoder, mlp, packed } = *self;
        let (k, stride) = (mlp.n_outputs, padded(mlp.n_inputs));
        let n_chunks = points.len().div_ceil(CHUNK);
        if chunks.len() < n_chunks {
            chunks.resize_with(n_chunks, || Chunk {
                x: vec![0.0; BLOCK * stride],
                d_x: vec![0.0; BLOCK * stride],
                encoding: encoder.scratch(CHUNK),
                scratch: MlpScratch::new(packed),
                gradient: MlpGradient::new(packed),
                loss: 0.0,
            });
        }
        let parts = points.par_chunks(CHUNK).zip(per_output.par_chunks(CHUNK * k));
        chunks[..n_chunks].par_iter_mut().zip(parts).enumerate().for_each(|(c, (chunk, (points, per_output)))| {
            let objective = objective.part(c * CHUNK, points.len());
            Arch::new().dispatch(ChunkStep { encoder, packed, objective, points, per_output, stride, chunk });
        });
        let mut loss = 0.0;
        network_gradient.fill(0.0);
        for chunk in &chunks[..n_chunks] {
            chunk.gradient.add_to(packed, network_gradient);
            loss += chunk.loss;
        }
        loss
    }
}

/// Forward, loss and backward of one chunk.
struct ChunkStep<'a, E: Encoder<D>, const D: usize> {
    encoder: &'a E,
    packed: &'a PackedMlp,
    objective: Objective<'a>,
    points: &'a [[f32; D]],
    per_output: &'a [f32],
    stride: usize,
    chunk: &'a mut Chunk<E::Scratch>,
}

impl<E: Encoder<D>, const D: usize> WithSimd for ChunkStep<'_, E, D> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { encoder, packed, objective, points, per_output, stride, chunk } = self;
        let k = per_output.len() / points.len();
        let Chunk { x, d_x, encoding, scratch, gradient, loss: chunk_loss } = chunk;
        gradient.clear();
        *chunk_loss = 0.0;
        for (b, (block, per_output)) in points.chunks(BLOCK).zip(per_output.chunks(BLOCK * k)).enumerate() {
            encoder.encode(block, encoding, x, stride);
            mlp::forward_block(simd, packed, x, block.len(), scratch);
            let (outputs, d_outputs) = scratch.output_and_gradient();
            d_outputs.fill(0.0);
            let rows = outputs.chunks_exact(padded(k)).zip(d_outputs.chunks_exact_mut(padded(k)));
            for (p, ((y, d), given)) in rows.zip(per_output.chunks_exact(k)).enumerate() {
                match objective {
                    Objective::Given => d[..k].copy_from_slice(given),
                    Objective::Regression { loss, weights, scale } => {
                        let weight = if weights.is_empty() { 1.0 } else { weights[b * BLOCK + p] };
                        let mut sum = 0.0;
                        for o in 0..k {
                            let (value, slope) = loss.at(y[o] - given[o]);
                            sum += value;
                            d[o] = scale * weight * slope;
                        }
                        *chunk_loss += (weight * sum) as f64;
                    }
                }
            }
            mlp::backward_block(simd, packed, x, block.len(), scratch, Some(gradient), d_x);
            encoder.collect(b * BLOCK, points.len(), &d_x[..block.len() * stride], stride, encoding);
        }
    }
}
