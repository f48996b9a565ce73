//! One block of rays, from its points to its gradients. Everything here is inlined into the dispatched function that
//! calls it, so that it is compiled for the processor's instructions.

use super::chunk::{Chunk, reserve};
use super::config::SurfaceConfig;
use super::ray_loss::{RayGradient, RayLoss};
use crate::encoding::hash_grid::{HashGrid, cpu as hash_grid};
use crate::field::columns::{Columns, POSITION_SLOPE, append_positions};
use crate::loss::cpu as loss;
use crate::mlp::cpu::{PackedMlp, padded, rows};
use crate::mlp::gradient;
use crate::reduce::dot;
use pulp::Simd;
use std::ops::Range;

/// What all blocks of a step read.
pub(super) struct Shared<'a, L> {
    pub(super) config: &'a SurfaceConfig,
    pub(super) grid: &'a HashGrid<3>,
    pub(super) table: &'a [f32],
    pub(super) packed: &'a PackedMlp,
    pub(super) inv_s: f64,
    /// Samples of the eikonal loss in the whole step.
    pub(super) n_eikonal: usize,
    pub(super) offsets: &'a [usize],
    pub(super) points: &'a [[f32; 3]],
    pub(super) loss: &'a L,
}

/// Sizes of a block, and where it lies.
#[derive(Clone, Copy)]
struct Sizes {
    /// First sample in the step.
    start: usize,
    /// First sample in the chunk.
    at: usize,
    /// Samples.
    n: usize,
    /// Features of a sample, network inputs, and inputs with padding.
    n_features: usize,
    n_inputs: usize,
    stride: usize,
    /// See [`super::SurfaceLoss::eikonal_every`].
    every: usize,
    /// Samples of the eikonal loss.
    n_tangents: usize,
}

/// Computes losses and gradients of a block of rays. `first_ray` is the first of the chunk.
#[inline(always)]
pub(super) fn process<S: Simd, L: RayLoss>(
    simd: S,
    shared: &Shared<L>,
    chunk: &mut Chunk,
    first_ray: usize,
    rays: Range<usize>,
) {
    let Shared { config, grid, packed, offsets, .. } = *shared;
    let every = config.loss.eikonal_every;
    let samples = offsets[rays.start]..offsets[rays.end];
    let n = samples.len();
    if n == 0 {
        // Rays without samples still have a mask and an image of nothing.
        return render(shared, chunk, first_ray, rays, 0);
    }
    let n_features = grid.n_features();
    let n_inputs = n_features + if config.field.append_position { 3 } else { 0 };
    let n_tangents = if every == 0 { 0 } else { n.div_ceil(every) };
    let (start, at, stride) = (samples.start, samples.start - chunk.samples.start, padded(n_inputs));
    let sizes = Sizes { start, at, n, n_features, n_inputs, stride, every, n_tangents };

    reserve(&mut chunk.x, rows(n) * stride);
    reserve(&mut chunk.d_x, rows(n) * stride);
    reserve(&mut chunk.jacobian, n_tangents * 3 * stride);
    reserve(&mut chunk.tangents, rows(n_tangents) * stride);
    reserve(&mut chunk.sdf, n);
    chunk.g.resize(n_tangents, [0.0; 3]);
    chunk.d_g.resize(n_tangents, [0.0; 3]);
    chunk.network.reserve(packed, n);

    forward(simd, shared, chunk, sizes);
    space_gradients(config, chunk, sizes);
    // What volume rendering and the losses send back to the distances.
    render(shared, chunk, first_ray, rays, n);
    sparsity(shared, chunk, sizes);
    // And what the eikonal loss sends to their gradients.
    if every > 0 {
        eikonal(shared, chunk, sizes);
    }
    let (x, s, v) = (&mut chunk.x[..], &chunk.s[at..at + n], &chunk.tangents[..]);
    gradient::accumulate(simd, packed, x, s, every, v, &mut chunk.network, &mut chunk.gradient);
}

/// Computes features and slopes, signed distances and their gradients by the features.
#[inline(always)]
fn forward<S: Simd, L: RayLoss>(simd: S, shared: &Shared<L>, chunk: &mut Chunk, sizes: Sizes) {
    let Shared { config, grid, table, packed, .. } = *shared;
    let Sizes { start, at, n, n_features, n_inputs, stride, every, .. } = sizes;
    let points = &shared.points[start..start + n];
    let x = &mut chunk.x[..rows(n) * stride];
    hash_grid::encode_inlined(grid, table, points, every, x, &mut chunk.jacobian, stride);
    for row in x.chunks_exact_mut(stride).take(n) {
        row[n_inputs..].fill(0.0);
    }
    x[n * stride..].fill(0.0);
    if config.field.append_position {
        append_positions(points, x, stride, n_features);
    }
    gradient::forward(simd, packed, x, n, &mut chunk.network, &mut chunk.sdf[..n], &mut chunk.d_x);
    Columns::new(grid, &mut chunk.d_features, chunk.samples.len()).write(at, &chunk.d_x[..n * stride], stride);
}

/// Computes the gradients of the distance in space, of the eikonal samples.
#[inline(always)]
fn space_gradients(config: &SurfaceConfig, chunk: &mut Chunk, sizes: Sizes) {
    let Sizes { n_features, stride, every, .. } = sizes;
    for (t, g) in chunk.g.iter_mut().enumerate() {
        let d = &chunk.d_x[t * every * stride..][..stride];
        let jacobian = &chunk.jacobian[t * 3 * stride..][..3 * stride];
        for a in 0..3 {
            let along = dot(&d[..n_features], &jacobian[a * stride..][..n_features]);
            let own = if config.field.append_position { POSITION_SLOPE * d[n_features + a] } else { 0.0 };
            g[a] = (along + own) / config.extent[a];
        }
    }
}

/// Computes the losses of rays, forward and backward: writes s of their `n` samples.
#[inline(always)]
fn render<L: RayLoss>(shared: &Shared<L>, chunk: &mut Chunk, first_ray: usize, rays: Range<usize>, n: usize) {
    let Shared { inv_s, offsets, loss, .. } = *shared;
    let start = offsets[rays.start];
    let at = start - chunk.samples.start;
    let s = &mut chunk.s[at..at + n];
    let (n_ray, n_sample) = (loss.n_ray_outputs(), loss.n_sample_outputs());
    for r in rays {
        let here = offsets[r] - start..offsets[r + 1] - start;
        let (mut gradients, mut d_gradients): (&[[f32; 3]], &mut [[f32; 3]]) = (&[], &mut []);
        if loss.needs_gradients() {
            (gradients, d_gradients) = (&chunk.g[here.clone()], &mut chunk.d_g[here.clone()]);
        }
        let out = RayGradient {
            losses: &mut chunk.losses,
            d_inv_s: &mut chunk.d_inv_s,
            d_sdf: &mut s[here.clone()],
            d_gradients,
            ray: &mut chunk.ray_outputs[(r - first_ray) * n_ray..][..n_ray],
            samples: &mut chunk.sample_outputs[(at + here.start) * n_sample..][..here.len() * n_sample],
        };
        loss.ray(r, &chunk.sdf[here], gradients, inv_s, &mut chunk.ray, out);
    }
}

/// Adds the sparsity loss and its gradients by the distances.
#[inline(always)]
fn sparsity<L: RayLoss>(shared: &Shared<L>, chunk: &mut Chunk, sizes: Sizes) {
    let Sizes { at, n, .. } = sizes;
    let scale = 1.0 / shared.points.len() as f64;
    let weight = (shared.config.loss.sparsity_weight * scale) as f32;
    let mut sum = 0.0;
    for (s, &f) in chunk.s[at..at + n].iter_mut().zip(&chunk.sdf[..n]) {
        let (value, slope) = loss::sparsity_at(f);
        sum += value as f64;
        *s += weight * slope;
    }
    chunk.losses.sparsity += sum * scale;
}

/// Adds the eikonal loss and writes its gradients u by the gradients in space, with their tangents.
#[inline(always)]
fn eikonal<L: RayLoss>(shared: &Shared<L>, chunk: &mut Chunk, sizes: Sizes) {
    let Shared { config, n_eikonal, .. } = *shared;
    let Sizes { at, n, n_features, stride, every, n_tangents, .. } = sizes;
    let scale = 1.0 / n_eikonal as f64;
    let weight = (config.loss.eikonal_weight * scale) as f32;
    chunk.u.iter_mut().for_each(|u| u[at..at + n].fill(0.0));
    chunk.tangents[n_tangents * stride..rows(n_tangents) * stride].fill(0.0);
    let mut sum = 0.0;
    for (t, tangent) in chunk.tangents.chunks_exact_mut(stride).enumerate().take(n_tangents) {
        let p = t * every;
        let jacobian = &chunk.jacobian[t * 3 * stride..][..3 * stride];
        let given = if shared.loss.needs_gradients() { chunk.d_g[t] } else { [0.0; 3] };
        let (value, slope) = loss::eikonal_at(chunk.g[t]);
        sum += value as f64;
        let u: [f32; 3] = std::array::from_fn(|a| (weight * slope[a] + given[a]) / config.extent[a]);
        let [j0, j1, j2] = std::array::from_fn(|a| &jacobian[a * stride..][..n_features]);
        for (i, tangent) in tangent[..n_features].iter_mut().enumerate() {
            *tangent = j0[i] * u[0] + j1[i] * u[1] + j2[i] * u[2];
        }
        tangent[n_features..].fill(0.0);
        if config.field.append_position {
            tangent[n_features..][..3].copy_from_slice(&u.map(|u| POSITION_SLOPE * u));
        }
        for a in 0..3 {
            chunk.u[a][at + p] = u[a];
        }
    }
    chunk.losses.eikonal += sum * scale;
}
