//! Evaluation of many points, for all forms of a field.

use super::encoder::Encoder;
use super::regression::Network;
use crate::mlp::cpu::{self as mlp, BLOCK, MlpScratch, padded};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Points of one task: enough to make its scratch memory cheap.
pub(super) const TASK: usize = 32 * BLOCK;

impl<E> Network<'_, E> {
    /// Writes the outputs of many points, in parallel: `out[point][output]`.
    pub(super) fn query<const D: usize>(&self, points: &[[f32; D]], out: &mut [f32])
    where
        E: Encoder<D>,
    {
        let k = self.mlp.n_outputs;
        assert_eq!(out.len(), points.len() * k);
        points.par_chunks(TASK).zip(out.par_chunks_mut(TASK * k)).for_each(|(points, out)| {
            Arch::new().dispatch(Query { network: self, points, out });
        });
    }
}

struct Query<'a, E, const D: usize> {
    network: &'a Network<'a, E>,
    points: &'a [[f32; D]],
    out: &'a mut [f32],
}

impl<E: Encoder<D>, const D: usize> WithSimd for Query<'_, E, D> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Network { encoder, mlp, packed } = *self.network;
        let (k, stride) = (mlp.n_outputs, padded(mlp.n_inputs));
        let (mut encoding, mut scratch) = (encoder.scratch(0), MlpScratch::new(packed));
        let mut x = vec![0.0; BLOCK * stride];
        for (points, out) in self.points.chunks(BLOCK).zip(self.out.chunks_mut(BLOCK * k)) {
            encoder.encode(points, &mut encoding, &mut x, stride);
            mlp::forward_block(simd, packed, &x, points.len(), &mut scratch);
            copy_outputs(&scratch, k, out);
        }
    }
}

/// Copies the outputs of a block, `out[point][output]`.
#[inline(always)]
pub(super) fn copy_outputs(scratch: &MlpScratch, k: usize, out: &mut [f32]) {
    for (y, out) in scratch.output().chunks_exact(padded(k)).zip(out.chunks_exact_mut(k)) {
        out.copy_from_slice(&y[..k]);
    }
}
