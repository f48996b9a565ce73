//! Evaluation of many points, also with derivatives.

use super::super::columns::{POSITION_SLOPE, append_positions};
use super::super::query::{TASK, copy_outputs};
use super::super::regression::Network;
use super::encoder::HashEncoder;
use super::field::HashField;
use crate::encoding::hash_grid::cpu as hash_grid;
use crate::mlp::cpu::{self as mlp, BLOCK, MlpScratch, padded};
use crate::reduce::dot;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

impl<const D: usize> HashField<D> {
    /// [`HashField::query`] in any dimension.
    pub(crate) fn query_points(&self, points: &[[f32; D]], out: &mut [f32]) {
        let table = &self.params[..self.grid.n_params()];
        let encoder = HashEncoder { grid: &self.grid, table, append: self.config.append_position };
        Network { encoder: &encoder, mlp: &self.mlp, packed: &self.packed }.query(points, out);
    }

    /// [`HashField::query_with_jacobian`] in any dimension.
    pub(super) fn query_points_with_jacobian(&self, points: &[[f32; D]], out: &mut [f32], jacobian: &mut [[f32; D]]) {
        let k = self.n_outputs();
        assert_eq!(out.len(), points.len() * k);
        assert_eq!(jacobian.len(), points.len() * k);
        let tasks = points.par_chunks(TASK).zip(out.par_chunks_mut(TASK * k)).zip(jacobian.par_chunks_mut(TASK * k));
        tasks.for_each(|((points, out), jacobian)| {
            Arch::new().dispatch(QueryWithJacobian { field: self, points, out, jacobian });
        });
    }
}

struct QueryWithJacobian<'a, const D: usize> {
    field: &'a HashField<D>,
    points: &'a [[f32; D]],
    out: &'a mut [f32],
    jacobian: &'a mut [[f32; D]],
}

impl<const D: usize> WithSimd for QueryWithJacobian<'_, D> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let HashField { config, grid, mlp, params, packed, .. } = self.field;
        let table = &params[..grid.n_params()];
        let k = self.field.n_outputs();
        let (n_features, stride) = (grid.n_features(), padded(mlp.n_inputs));
        let mut scratch = MlpScratch::new(packed);
        let mut x = vec![0.0; BLOCK * stride];
        let mut d_x = x.clone();
        let mut slopes = vec![0.0; BLOCK * D * stride];
        let blocks = self.points.chunks(BLOCK).zip(self.out.chunks_mut(BLOCK * k));
        for ((points, out), jacobian) in blocks.zip(self.jacobian.chunks_mut(BLOCK * k)) {
            hash_grid::encode_inlined(grid, table, points, 1, &mut x, &mut slopes, stride);
            if config.append_position {
                append_positions(points, &mut x, stride, n_features);
            }
            mlp::forward_block(simd, packed, &x, points.len(), &mut scratch);
            copy_outputs(&scratch, k, out);
            for o in 0..k {
                let seed = scratch.output_and_gradient().1;
                seed.fill(0.0);
                for d in seed.chunks_exact_mut(padded(k)) {
                    d[o] = 1.0;
                }
                mlp::backward_block(simd, packed, &x, points.len(), &mut scratch, None, &mut d_x);
                let rows = d_x.chunks_exact(stride).zip(slopes.chunks_exact(D * stride));
                for ((d, slopes), jacobian) in rows.zip(jacobian.chunks_exact_mut(k)) {
                    for a in 0..D {
                        jacobian[o][a] = dot(&d[..n_features], &slopes[a * stride..][..n_features]);
                        if config.append_position {
                            jacobian[o][a] += POSITION_SLOPE * d[n_features + a];
                        }
                    }
                }
            }
        }
    }
}
