//! Fast form of a step. A block of whole rays goes from its points to its share of the network's gradient without
//! leaving the second-level cache: one gather gives features and Jacobian, one backward pass serves both the distance
//! and its gradient (see [`crate::mlp::gradient`]), compositing and losses work on the block's rays, and what remains
//! for the table is 2 values per level and point, with one s and one u per point. Then every part of the table is
//! scattered into and updated by its one owner ([`crate::field::table`]).

use super::batch::{SurfaceBatch, blocks};
use super::block::{self, Shared};
use super::chunk::{Chunk, StepScratch, reserve};
use super::codeword::Codewords;
use super::losses::SurfaceLosses;
use super::neural::NeuralSurface;
use super::ray_loss::{RayGradient, RayLoss, RayScratch};
use crate::adam;
use crate::field::table::Part;
use crate::field::training::ParameterUpdate;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;

/// Blocks whose network gradients are summed before anything else: fixed, so that sums do not depend on threads.
const BLOCKS: usize = 8;

impl NeuralSurface {
    /// Takes one step of the optimizer; returns the losses before it. Writes the gradient of the batch's ambient
    /// fractions to `d_ambient`, `[ray][k]` (empty: not wanted). No rays: nothing happens.
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

    /// Takes one step of the optimizer for another image formation. `offsets` and `points` as in [`SurfaceBatch`]; what
    /// the loss sends back goes to `ray_outputs`, `[ray][value]`, and `sample_outputs`, `[sample][value]` (empty: not
    /// wanted).
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
        let n_chunks = self.compute_gradients(offsets, points, loss, inv_s);
        let chunks = &self.scratch.chunks[..n_chunks];
        collect_outputs(chunks, ray_outputs, |chunk| &chunk.ray_outputs);
        collect_outputs(chunks, sample_outputs, |chunk| &chunk.sample_outputs);
        let mut losses = SurfaceLosses::default();
        chunks.iter().for_each(|chunk| losses.add(&chunk.losses));
        losses.sum(&self.config.loss);
        self.update(points, n_chunks, inv_s);
        losses
    }

    /// Computes the gradients of all chunks, the first of the scratch memory's; returns how many there are.
    fn compute_gradients<L: RayLoss>(&mut self, offsets: &[usize], points: &[[f32; 3]], loss: &L, inv_s: f64) -> usize {
        let Self { config, field, scratch, .. } = self;
        let StepScratch { blocks: all_blocks, chunks } = scratch;
        all_blocks.clear();
        all_blocks.extend(blocks(offsets));
        let n_chunks = all_blocks.len().div_ceil(BLOCKS);
        if chunks.len() < n_chunks {
            chunks.resize_with(n_chunks, || Chunk::new(&field.packed));
        }
        let every = config.loss.eikonal_every;
        let samples_of = |rays: &Range<usize>| offsets[rays.end] - offsets[rays.start];
        let n_eikonal: usize =
            if every == 0 { 0 } else { all_blocks.iter().map(|b| samples_of(b).div_ceil(every)).sum() };
        let (grid, packed) = (&field.grid, &field.packed);
        let table = &field.params[..grid.n_params()];
        let shared = Shared { config, grid, table, packed, inv_s, n_eikonal, offsets, points, loss };
        let tasks = chunks[..n_chunks].par_iter_mut().zip(all_blocks.par_chunks(BLOCKS));
        tasks.for_each(|(chunk, blocks)| Arch::new().dispatch(ChunkStep { shared: &shared, blocks, chunk }));
        n_chunks
    }

    /// Updates the field and the sharpness by the gradients of the first `n_chunks` chunks.
    fn update(&mut self, points: &[[f32; 3]], n_chunks: usize, inv_s: f64) {
        let Self { config, field, sharpness, sharpness_moments, scratch } = self;
        let every = config.loss.eikonal_every;
        let training = &mut **field.training.get_or_insert_default();
        training.prepare(&config.field.training, &field.mlp, &field.params);
        let (grid, packed, chunks) = (&field.grid, &field.packed, &scratch.chunks[..n_chunks]);
        let (table, network) = field.params.split_at_mut(grid.n_params());
        training.network_gradient.fill(0.0);
        let mut d_inv_s = 0.0;
        for chunk in chunks {
            chunk.gradient.add_to(packed, &mut training.network_gradient);
            d_inv_s += chunk.d_inv_s;
        }
        let part = |i: usize| {
            let chunk = &chunks[i];
            let n = chunk.samples.len();
            let d = &chunk.d_features[..n * grid.n_features()];
            let u = chunk.u.each_ref().map(|u| if every == 0 { &[] } else { &u[..n] });
            Part { points: &points[chunk.samples.clone()], d, s: &chunk.s[..n], u }
        };
        let (settings, step) = (&config.field.training, training.n_steps);
        let update = ParameterUpdate { settings, grid, mlp: &field.mlp, part: &part, n_parts: n_chunks };
        update.run(table, network, training);
        field.packed.pack(network);
        if config.sharpness_learning_rate > 0.0 {
            let rate = config.sharpness_learning_rate * settings.schedule.factor(step);
            let d_sharpness = (10.0 * inv_s * d_inv_s) as f32;
            let sharpness = std::slice::from_mut(sharpness);
            adam::cpu::step(&settings.adam, rate, step, sharpness, sharpness_moments.all(), &[d_sharpness]);
        }
    }
}

/// Copies what the chunks send back to the caller, one after the other, into `out`; not if that is empty.
fn collect_outputs(chunks: &[Chunk], out: &mut [f32], outputs: impl Fn(&Chunk) -> &[f32]) {
    let mut left = out;
    for chunk in chunks {
        if left.is_empty() {
            return;
        }
        let from = outputs(chunk);
        let (mine, tail) = left.split_at_mut(from.len());
        mine.copy_from_slice(from);
        left = tail;
    }
}

/// The loss of a caller outside this crate: called, not inlined, so that the kernels are compiled here and only once
/// for all of them.
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

/// One chunk of a step.
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
            block::process(simd, shared, chunk, rays.start, block.clone());
        }
    }
}
