//! Fast form of a step. A block of whole rays goes from its points to its share of the network's gradient without leaving
//! the second-level cache: one gather gives features and Jacobian, one backward pass serves both the distance and its
//! gradient (see [`crate::mlp::gradient`]), compositing and losses work on the block's rays, and what remains for the table
//! is 2 values per level and point, with one s and one u per point. Then every part of the table is scattered into and
//! updated by its one owner ([`crate::field::table`]).

use super::{NeuralSurface, SurfaceBatch, SurfaceConfig, SurfaceLosses, blocks};
use crate::adam;
use crate::encoding::hash_grid::{HashGrid, cpu as hash_grid};
use crate::field::table::Part;
use crate::field::train::{Columns, Update, append_positions};
use crate::loss::cpu as loss;
use crate::mlp::cpu::{MlpGradient, PackedMlp, padded, rows};
use crate::mlp::gradient::{self, GradientScratch};
use crate::reduce::dot;
use crate::volrend::cpu as volrend;
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
    d_ambient: Vec<f32>,
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
    weights: Vec<f32>,
    d_weights: Vec<f32>,
    /// Of one ray.
    steps: Vec<volrend::Step>,
    image: Vec<f32>,
    network: GradientScratch,
}

impl Chunk {
    fn new(packed: &PackedMlp) -> Self {
        Self {
            samples: 0..0,
            gradient: MlpGradient::new(packed),
            losses: SurfaceLosses::default(),
            d_inv_s: 0.0,
            d_ambient: Vec::new(),
            d_features: Vec::new(),
            s: Vec::new(),
            u: Default::default(),
            x: Vec::new(),
            d_x: Vec::new(),
            jacobian: Vec::new(),
            tangents: Vec::new(),
            sdf: Vec::new(),
            weights: Vec::new(),
            d_weights: Vec::new(),
            steps: Vec::new(),
            image: Vec::new(),
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
        if batch.n_rays() == 0 {
            return SurfaceLosses::default();
        }
        let inv_s = self.inv_s();
        let Self { config, field, sharpness, sharpness_moments, scratch } = self;
        let StepScratch { blocks: all_blocks, chunks } = scratch;
        all_blocks.clear();
        all_blocks.extend(blocks(batch.offsets));
        let n_chunks = all_blocks.len().div_ceil(BLOCKS);
        if chunks.len() < n_chunks {
            chunks.resize_with(n_chunks, || Chunk::new(&field.packed));
        }
        let chunks = &mut chunks[..n_chunks];
        let every = config.loss.eikonal_every;
        let samples_of = |rays: &Range<usize>| batch.offsets[rays.end] - batch.offsets[rays.start];
        let n_eikonal: usize =
            if every == 0 { 0 } else { all_blocks.iter().map(|b| samples_of(b).div_ceil(every)).sum() };

        let training = &mut **field.training.get_or_insert_default();
        training.prepare(&config.field.training, &field.mlp, &field.params);
        let (grid, packed) = (&field.grid, &field.packed);
        let (table, network) = field.params.split_at_mut(grid.n_params());
        let shared = Shared { config, grid, table, packed, inv_s, n_eikonal, batch };
        chunks.par_iter_mut().zip(all_blocks.par_chunks(BLOCKS)).for_each(|(chunk, blocks)| {
            Arch::new().dispatch(ChunkStep { shared: &shared, blocks, chunk });
        });

        let mut losses = SurfaceLosses::default();
        let mut d_inv_s = 0.0;
        let mut rest = d_ambient;
        training.network_gradient.fill(0.0);
        for chunk in &*chunks {
            chunk.gradient.add_to(packed, &mut training.network_gradient);
            losses.image += chunk.losses.image;
            losses.mask += chunk.losses.mask;
            losses.eikonal += chunk.losses.eikonal;
            losses.sparsity += chunk.losses.sparsity;
            d_inv_s += chunk.d_inv_s;
            if !rest.is_empty() {
                let (mine, tail) = rest.split_at_mut(chunk.d_ambient.len());
                mine.copy_from_slice(&chunk.d_ambient);
                rest = tail;
            }
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
            Part { points: &batch.points[chunk.samples.clone()], d, s: &chunk.s[..n], u }
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

/// What all chunks of a step read.
struct Shared<'a> {
    config: &'a SurfaceConfig,
    grid: &'a HashGrid<3>,
    table: &'a [f32],
    packed: &'a PackedMlp,
    inv_s: f64,
    n_eikonal: usize,
    batch: &'a SurfaceBatch<'a>,
}

struct ChunkStep<'a> {
    shared: &'a Shared<'a>,
    blocks: &'a [Range<usize>],
    chunk: &'a mut Chunk,
}

impl WithSimd for ChunkStep<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { shared, blocks, chunk } = self;
        let Shared { grid, batch, .. } = *shared;
        let rays = blocks[0].start..blocks[blocks.len() - 1].end;
        chunk.samples = batch.offsets[rays.start]..batch.offsets[rays.end];
        let n = chunk.samples.len();
        reserve(&mut chunk.d_features, n * grid.n_features());
        reserve(&mut chunk.s, n);
        chunk.u.iter_mut().for_each(|u| reserve(u, n));
        chunk.d_ambient.resize(rays.len() * batch.k(), 0.0);
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
fn work<S: Simd>(simd: S, shared: &Shared, chunk: &mut Chunk, first_ray: usize, rays: Range<usize>) {
    let Shared { config, grid, table, packed, n_eikonal, batch, .. } = *shared;
    let settings = &config.loss;
    let every = settings.eikonal_every;
    let samples = batch.offsets[rays.start]..batch.offsets[rays.end];
    let n = samples.len();
    if n == 0 {
        // Rays without samples still have a mask and an image of nothing.
        return render(shared, chunk, first_ray, rays, 0);
    }
    let points = &batch.points[samples.clone()];
    let n_features = grid.n_features();
    let n_inputs = n_features + if config.field.append_position { 3 } else { 0 };
    let stride = padded(n_inputs);
    let n_tangents = if every == 0 { 0 } else { n.div_ceil(every) };
    let at = samples.start - chunk.samples.start;

    reserve(&mut chunk.x, rows(n) * stride);
    reserve(&mut chunk.d_x, rows(n) * stride);
    reserve(&mut chunk.jacobian, n_tangents * 3 * stride);
    reserve(&mut chunk.tangents, rows(n_tangents) * stride);
    for values in [&mut chunk.sdf, &mut chunk.weights, &mut chunk.d_weights] {
        reserve(values, n);
    }
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

    // What volume rendering and the losses send back to the distances.
    render(shared, chunk, first_ray, rays, n);
    let s = &mut chunk.s[at..at + n];
    let sparsity_scale = 1.0 / batch.points.len() as f64;
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
            let d = &chunk.d_x[p * stride..][..stride];
            let jacobian = &chunk.jacobian[t * 3 * stride..][..3 * stride];
            let mut g: [f32; 3] = std::array::from_fn(|a| dot(&d[..n_features], &jacobian[a * stride..][..n_features]));
            for a in 0..3 {
                if config.field.append_position {
                    g[a] += d[n_features + a];
                }
                g[a] /= config.extent[a];
            }
            let (value, slope) = loss::eikonal_at(g);
            eikonal += value as f64;
            let u: [f32; 3] = std::array::from_fn(|a| weight * slope[a] / config.extent[a]);
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

    /// Compositing and the losses of rays, forward and backward: writes s of their `n` samples.
    #[inline(always)]
    fn render(shared: &Shared, chunk: &mut Chunk, first_ray: usize, rays: Range<usize>, n: usize) {
        let Shared { config, inv_s, batch, .. } = *shared;
        let settings = &config.loss;
        let k = batch.k();
        let n_rays = batch.n_rays();
        let image_scale = 1.0 / (n_rays * k).max(1) as f64;
        let alpha = settings.lookup_loss_weight as f32;
        let mask_scale = 1.0 / n_rays as f64;
        let d_mask = (settings.mask_weight * mask_scale) as f32;
        let start = batch.offsets[rays.start];
        let at = start - chunk.samples.start;
        let s = &mut chunk.s[at..at + n];
        let (mut image_loss, mut mask_loss) = (0.0, 0.0);
        chunk.image.resize(k, 0.0);
        for r in rays {
            let here = batch.offsets[r] - start..batch.offsets[r + 1] - start;
            let sdf = &chunk.sdf[here.clone()];
            let weights = &mut chunk.weights[here.clone()];
            volrend::forward_ray(sdf, inv_s, weights, &mut chunk.steps);
            let colors = &batch.colors[batch.offsets[r] * k..batch.offsets[r + 1] * k];
            chunk.image.fill(0.0);
            let mut opacity = 0.0f64;
            for (&w, colors) in weights.iter().zip(colors.chunks_exact(k.max(1))) {
                opacity += w as f64;
                chunk.image.iter_mut().zip(colors).for_each(|(sum, c)| *sum += w * c);
            }
            let d_ambient = &mut chunk.d_ambient[(r - first_ray) * k..][..k];
            for (c, image) in chunk.image.iter_mut().enumerate() {
                let i = r * k + c;
                let a = batch.ambient.get(i).copied().unwrap_or(0.0);
                let white = batch.white.get(i).copied().unwrap_or(1.0);
                let residual = *image * (1.0 - a) + a - batch.measured[i];
                let (lookup, d_lookup) = loss::robust_at(settings.norms, residual);
                let (pattern, d_pattern) = loss::robust_at(settings.norms, white * residual);
                image_loss += (batch.mask[r] * ((1.0 - alpha) * pattern + alpha * lookup)) as f64;
                let scale = batch.mask[r] * image_scale as f32;
                let d = ((1.0 - alpha) * white * d_pattern + alpha * d_lookup) * scale;
                d_ambient[c] = d * (1.0 - *image);
                // From here on its gradient.
                *image = d * (1.0 - a);
            }
            let (value, slope, d_log_transmittance) = if settings.clamped_mask {
                let (value, slope) = loss::mask_at(opacity as f32, batch.mask[r]);
                (value as f64, slope, 0.0)
            } else {
                let log_transmittance = volrend::log_transmittance(&chunk.steps);
                let (value, slope) = loss::mask_log_at(log_transmittance, batch.mask[r] as f64);
                (value, 0.0, d_mask as f64 * slope)
            };
            mask_loss += value;
            let d_weights = &mut chunk.d_weights[here.clone()];
            for (d, colors) in d_weights.iter_mut().zip(colors.chunks_exact(k.max(1))) {
                *d = d_mask * slope + chunk.image.iter().zip(colors).map(|(d, c)| d * c).sum::<f32>();
            }
            let d_sdf = &mut s[here];
            chunk.d_inv_s +=
                volrend::backward_ray(sdf, inv_s, weights, &chunk.steps, d_weights, d_log_transmittance, d_sdf);
        }
        chunk.losses.image += image_loss * image_scale;
        chunk.losses.mask += mask_loss * mask_scale;
    }
}
