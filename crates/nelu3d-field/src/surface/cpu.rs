//! Fast form of a step. A block of whole rays goes from its points to its share of the network's gradient without leaving
//! the second-level cache: one gather gives features and Jacobian, one backward pass serves both the distance and its
//! gradient (see [`crate::mlp::gradient`]), compositing and losses work on the block's rays, and what remains for the table
//! is 2 values per level and point, with one s and one u per point. Then every part of the table is scattered into and
//! updated by its one owner ([`crate::field::table`]).

use super::codeword::Codewords;
use super::{NeuralSurface, RayGradient, RayLoss, RayScratch, SurfaceBatch, SurfaceConfig, SurfaceLosses, blocks};
use crate::adam;
use crate::encoding::hash_grid::{HashGrid, cpu as hash_grid};
use crate::field::table::Part;
use crate::field::train::{Columns, Update, append_positions};
use crate::loss::cpu as loss;
use crate::mlp::cpu::{MlpGradient, PackedMlp, padded, rows};
use crate::mlp::gradient::{self, GradientScratch};
use crate::reduce::dot;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;

/// Blocks whose network gradients are summed before anything else: fixed, so that sums do not depend on threads.
const BLOCKS: usize = 8;

/// Memory of a step, kept for the next one.
#[derive(Debug, Default)]
pub(super) struct StepScratch {
    blocks: Vec<Range<usize>>,
    chunks: Vec<Chunk>,
}

impl Clone for StepScratch {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// Sums and scratch of a few blocks.
#[derive(Debug)]
struct Chunk {
    /// Samples of this chunk.
    samples: Range<usize>,
    gradient: MlpGradient,
    losses: SurfaceLosses,
    d_inv_s: f64,
    /// What the rays, and their samples, send back to the caller.
    ray_outputs: Vec<f32>,
    sample_outputs: Vec<f32>,
    /// Gradients of the signed distance by the features, `[level][point][feature]`.
    d_features: Vec<f32>,
    /// s = ∂L/∂f of every point.
    s: Vec<f32>,
    /// u = ∂L/∂(∂f/∂x), per unit of x, `[axis][point]`.
    u: [Vec<f32>; 3],
    // The rest is of one block.
    /// Network inputs, `[row][stride]`.
    x: Vec<f32>,
    /// Gradients of f by them.
    d_x: Vec<f32>,
    /// Jacobians of the eikonal points' inputs, `[point][axis][stride]`.
    jacobian: Vec<f32>,
    /// What the eikonal loss sends along them, `[row][stride]`.
    tangents: Vec<f32>,
    sdf: Vec<f32>,
    /// Gradients of f in space, of the eikonal points, and what the loss sends to them.
    g: Vec<[f32; 3]>,
    d_g: Vec<[f32; 3]>,
    /// Of one ray.
    ray: RayScratch,
    network: GradientScratch,
}

impl Chunk {
    fn new(packed: &PackedMlp) -> Self {
        Self {
            samples: 0..0,
            gradient: MlpGradient::new(packed),
            losses: SurfaceLosses::default(),
            d_inv_s: 0.0,
            ray_outputs: Vec::new(),
            sample_outputs: Vec::new(),
            d_features: Vec::new(),
            s: Vec::new(),
            u: Default::default(),
            x: Vec::new(),
            d_x: Vec::new(),
            jacobian: Vec::new(),
            tangents: Vec::new(),
            sdf: Vec::new(),
            g: Vec::new(),
            d_g: Vec::new(),
            ray: RayScratch::default(),
            network: GradientScratch::default(),
        }
    }
}

/// Grows, never shrinks: what is there is overwritten before it is read.
fn reserve(values: &mut Vec<f32>, n: usize) {
    if values.len() < n {
        values.resize(n, 0.0);
    }
}

impl NeuralSurface {
    /// One step of the optimizer; returns the losses before it. Writes the gradient of the batch's ambient shares to
    /// `d_ambient`, `[ray][k]` (empty: not wanted). No rays: nothing happens.
    ///
    /// The same parameters and batch give the same bits on any number of threads.
    ///
    /// # Panics
    /// If a length does not fit.
    pub fn train_step(&mut self, batch: &SurfaceBatch, d_ambient: &mut [f32]) -> SurfaceLosses {
        batch.check(d_ambient);
        let settings = self.config.loss.clone();
        let loss = Codewords { batch, settings: &settings };
        self.step_with(batch.offsets, batch.points, &loss, d_ambient, &mut [])
    }

    /// One step of the optimizer for another image formation. `offsets` and `points` as in [`SurfaceBatch`]; what the loss
    /// sends back goes to `ray_outputs`, `[ray][value]`, and `sample_outputs`, `[sample][value]` (empty: not wanted).
    ///
    /// # Panics
    /// If a length does not fit, or if the loss needs gradients of which only some are computed.
    pub fn step(
        &mut self,
        offsets: &[usize],
        points: &[[f32; 3]],
        loss: &dyn RayLoss,
        ray_outputs: &mut [f32],
        sample_outputs: &mut [f32],
    ) -> SurfaceLosses {
        self.step_with(offsets, points, &Dynamic(loss), ray_outputs, sample_outputs)
    }

    fn step_with<L: RayLoss>(
        &mut self,
        offsets: &[usize],
        points: &[[f32; 3]],
        loss: &L,
        ray_outputs: &mut [f32],
        sample_outputs: &mut [f32],
    ) -> SurfaceLosses {
        let n_rays = offsets.len() - 1;
        assert!(offsets[0] == 0 && offsets[n_rays] == points.len() && offsets.is_sorted());
        assert!(ray_outputs.is_empty() || ray_outputs.len() == n_rays * loss.n_ray_outputs());
        assert!(sample_outputs.is_empty() || sample_outputs.len() == points.len() * loss.n_sample_outputs());
        assert!(!loss.needs_gradients() || self.config.loss.eikonal_every == 1);
        if n_rays == 0 {
            return SurfaceLosses::default();
        }
        let inv_s = self.inv_s();
        let Self { config, field, sharpness, sharpness_moments, scratch } = self;
        let StepScratch { blocks: all_blocks, chunks } = scratch;
        all_blocks.clear();
        all_blocks.extend(blocks(offsets));
        let n_chunks = all_blocks.len().div_ceil(BLOCKS);
        if chunks.len() < n_chunks {
            chunks.resize_with(n_chunks, || Chunk::new(&field.packed));
        }
        let chunks = &mut chunks[..n_chunks];
        let every = config.loss.eikonal_every;
        let samples_of = |rays: &Range<usize>| offsets[rays.end] - offsets[rays.start];
        let n_eikonal: usize =
            if every == 0 { 0 } else { all_blocks.iter().map(|b| samples_of(b).div_ceil(every)).sum() };

        let training = &mut **field.training.get_or_insert_default();
        training.prepare(&config.field.training, &field.mlp, &field.params);
        let (grid, packed) = (&field.grid, &field.packed);
        let (table, network) = field.params.split_at_mut(grid.n_params());
        let shared = Shared { config, grid, table, packed, inv_s, n_eikonal, offsets, points, loss };
        chunks.par_iter_mut().zip(all_blocks.par_chunks(BLOCKS)).for_each(|(chunk, blocks)| {
            Arch::new().dispatch(ChunkStep { shared: &shared, blocks, chunk });
        });

        let mut losses = SurfaceLosses::default();
        let mut d_inv_s = 0.0;
        let (mut rays_left, mut samples_left) = (ray_outputs, sample_outputs);
        let copy = |left: &mut &mut [f32], from: &[f32]| {
            if !left.is_empty() {
                let (mine, tail) = std::mem::take(left).split_at_mut(from.len());
                mine.copy_from_slice(from);
                *left = tail;
            }
        };
        training.network_gradient.fill(0.0);
        for chunk in &*chunks {
            chunk.gradient.add_to(packed, &mut training.network_gradient);
            losses.image += chunk.losses.image;
            losses.mask += chunk.losses.mask;
            losses.eikonal += chunk.losses.eikonal;
            losses.sparsity += chunk.losses.sparsity;
            d_inv_s += chunk.d_inv_s;
            copy(&mut rays_left, &chunk.ray_outputs);
            copy(&mut samples_left, &chunk.sample_outputs);
        }
        let weights = &config.loss;
        losses.total = losses.image
            + weights.mask_weight * losses.mask
            + weights.eikonal_weight * losses.eikonal
            + weights.sparsity_weight * losses.sparsity;

        let chunks = &*chunks;
        let part = |i: usize| {
            let chunk = &chunks[i];
            let n = chunk.samples.len();
            let d = &chunk.d_features[..n * grid.n_features()];
            let u = chunk.u.each_ref().map(|u| if every == 0 { &[] } else { &u[..n] });
            Part { points: &points[chunk.samples.clone()], d, s: &chunk.s[..n], u }
        };
        let (settings, step) = (&config.field.training, training.n_steps);
        Update { settings, grid, mlp: &field.mlp, part: &part, n_parts: n_chunks }.run(table, network, training);
        field.packed.pack(network);
        if config.sharpness_learning_rate > 0.0 {
            let rate = config.sharpness_learning_rate * settings.schedule.factor(step);
            let d_sharpness = (10.0 * inv_s * d_inv_s) as f32;
            adam::cpu::step(
                &settings.adam,
                rate,
                step,
                std::slice::from_mut(sharpness),
                sharpness_moments.all(),
                &[d_sharpness],
            );
        }
        losses
    }
}

/// Somebody else's loss: called, not inlined, so that the kernels are compiled here and only once for all of them.
struct Dynamic<'a>(&'a dyn RayLoss);

impl RayLoss for Dynamic<'_> {
    fn needs_gradients(&self) -> bool {
        self.0.needs_gradients()
    }

    fn n_ray_outputs(&self) -> usize {
        self.0.n_ray_outputs()
    }

    fn n_sample_outputs(&self) -> usize {
        self.0.n_sample_outputs()
    }

    fn ray(
        &self,
        ray: usize,
        sdf: &[f32],
        gradients: &[[f32; 3]],
        inv_s: f64,
        scratch: &mut RayScratch,
        out: RayGradient<'_>,
    ) {
        self.0.ray(ray, sdf, gradients, inv_s, scratch, out);
    }
}

/// What all chunks of a step read.
struct Shared<'a, L> {
    config: &'a SurfaceConfig,
    grid: &'a HashGrid<3>,
    table: &'a [f32],
    packed: &'a PackedMlp,
    inv_s: f64,
    n_eikonal: usize,
    offsets: &'a [usize],
    points: &'a [[f32; 3]],
    loss: &'a L,
}

struct ChunkStep<'a, L> {
    shared: &'a Shared<'a, L>,
    blocks: &'a [Range<usize>],
    chunk: &'a mut Chunk,
}

impl<L: RayLoss> WithSimd for ChunkStep<'_, L> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { shared, blocks, chunk } = self;
        let Shared { grid, offsets, loss, .. } = *shared;
        let rays = blocks[0].start..blocks[blocks.len() - 1].end;
        chunk.samples = offsets[rays.start]..offsets[rays.end];
        let n = chunk.samples.len();
        reserve(&mut chunk.d_features, n * grid.n_features());
        reserve(&mut chunk.s, n);
        chunk.u.iter_mut().for_each(|u| reserve(u, n));
        chunk.ray_outputs.resize(rays.len() * loss.n_ray_outputs(), 0.0);
        chunk.sample_outputs.resize(n * loss.n_sample_outputs(), 0.0);
        chunk.gradient.clear();
        chunk.losses = SurfaceLosses::default();
        chunk.d_inv_s = 0.0;
        for block in blocks {
            work(simd, shared, chunk, rays.start, block.clone());
        }
    }
}

/// One block of rays, from its points to its gradients.
#[inline(always)]
fn work<S: Simd, L: RayLoss>(simd: S, shared: &Shared<L>, chunk: &mut Chunk, first_ray: usize, rays: Range<usize>) {
    let Shared { config, grid, table, packed, n_eikonal, offsets, .. } = *shared;
    let settings = &config.loss;
    let every = settings.eikonal_every;
    let samples = offsets[rays.start]..offsets[rays.end];
    let n = samples.len();
    if n == 0 {
        // Rays without samples still have a mask and an image of nothing.
        return render(shared, chunk, first_ray, rays, 0);
    }
    let points = &shared.points[samples.clone()];
    let n_features = grid.n_features();
    let n_inputs = n_features + if config.field.append_position { 3 } else { 0 };
    let stride = padded(n_inputs);
    let n_tangents = if every == 0 { 0 } else { n.div_ceil(every) };
    let at = samples.start - chunk.samples.start;

    reserve(&mut chunk.x, rows(n) * stride);
    reserve(&mut chunk.d_x, rows(n) * stride);
    reserve(&mut chunk.jacobian, n_tangents * 3 * stride);
    reserve(&mut chunk.tangents, rows(n_tangents) * stride);
    reserve(&mut chunk.sdf, n);
    chunk.g.resize(n_tangents, [0.0; 3]);
    chunk.d_g.resize(n_tangents, [0.0; 3]);
    chunk.network.reserve(packed, n);

    // Features and slopes, signed distances and their gradients by the features.
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

    for (t, g) in chunk.g.iter_mut().enumerate() {
        let d = &chunk.d_x[t * every * stride..][..stride];
        let jacobian = &chunk.jacobian[t * 3 * stride..][..3 * stride];
        for a in 0..3 {
            let along = dot(&d[..n_features], &jacobian[a * stride..][..n_features]);
            let own = if config.field.append_position { d[n_features + a] } else { 0.0 };
            g[a] = (along + own) / config.extent[a];
        }
    }

    // What volume rendering and the losses send back to the distances.
    render(shared, chunk, first_ray, rays, n);
    let s = &mut chunk.s[at..at + n];
    let sparsity_scale = 1.0 / shared.points.len() as f64;
    let sparsity_weight = (settings.sparsity_weight * sparsity_scale) as f32;
    let mut sparsity = 0.0;
    for (s, &f) in s.iter_mut().zip(&chunk.sdf[..n]) {
        let (value, slope) = loss::sparsity_at(f);
        sparsity += value as f64;
        *s += sparsity_weight * slope;
    }
    chunk.losses.sparsity += sparsity * sparsity_scale;

    // And what the eikonal loss sends to their gradients.
    if every > 0 {
        let eikonal_scale = 1.0 / n_eikonal as f64;
        let weight = (settings.eikonal_weight * eikonal_scale) as f32;
        chunk.u.iter_mut().for_each(|u| u[at..at + n].fill(0.0));
        chunk.tangents[n_tangents * stride..rows(n_tangents) * stride].fill(0.0);
        let mut eikonal = 0.0;
        for (t, tangent) in chunk.tangents.chunks_exact_mut(stride).enumerate().take(n_tangents) {
            let p = t * every;
            let jacobian = &chunk.jacobian[t * 3 * stride..][..3 * stride];
            let given = if shared.loss.needs_gradients() { chunk.d_g[t] } else { [0.0; 3] };
            let (value, slope) = loss::eikonal_at(chunk.g[t]);
            eikonal += value as f64;
            let u: [f32; 3] = std::array::from_fn(|a| (weight * slope[a] + given[a]) / config.extent[a]);
            let [j0, j1, j2] = std::array::from_fn(|a| &jacobian[a * stride..][..n_features]);
            for (i, tangent) in tangent[..n_features].iter_mut().enumerate() {
                *tangent = j0[i] * u[0] + j1[i] * u[1] + j2[i] * u[2];
            }
            tangent[n_features..].fill(0.0);
            if config.field.append_position {
                tangent[n_features..][..3].copy_from_slice(&u);
            }
            for a in 0..3 {
                chunk.u[a][at + p] = u[a];
            }
        }
        chunk.losses.eikonal += eikonal * eikonal_scale;
    }
    let (x, s, v) = (&mut chunk.x[..], &chunk.s[at..at + n], &chunk.tangents[..]);
    gradient::accumulate(simd, packed, x, s, every, v, &mut chunk.network, &mut chunk.gradient);

    /// The losses of rays, forward and backward: writes s of their `n` samples.
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
}
