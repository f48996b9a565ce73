//! One training step: weighted regression of the outputs on targets.
//!
//! Points are cut into chunks of fixed size; a chunk sums its own network gradient, and the chunks' sums are added in
//! order. Then every part of the table is owned by one task, which scatters all points' gradients into it and updates
//! the lines it touched ([`super::table`]). Neither depends on the number of threads.

use super::table::{Part, Scratch, TableStep};
use super::{HashField, RegressionLoss, TrainConfig};
use crate::adam::{self, MomentBuffers};
use crate::encoding::hash_grid::{HashGrid, cpu as hash_grid};
use crate::mlp::cpu::{self as mlp, BLOCK, MlpGradient, MlpScratch, PackedMlp, padded};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Points whose network gradients are summed before anything else: fixed, so that sums do not depend on threads.
const CHUNK: usize = 8 * BLOCK;

/// What training needs beside the parameters.
#[derive(Debug, Default)]
pub(crate) struct Training {
    /// Steps done.
    pub(crate) n_steps: u64,
    pub(crate) moments: MomentBuffers,
    pub(crate) network_gradient: Vec<f32>,
    chunks: Vec<Chunk>,
    pub(crate) table: Scratch,
}

impl Training {
    /// For this many parameters, the last `n_network` of them the network's.
    pub(crate) fn resize(&mut self, n_params: usize, n_network: usize) {
        if self.moments.first.len() != n_params {
            self.moments = MomentBuffers::new(n_params);
        }
        self.network_gradient.resize(n_network, 0.0);
    }
}

impl Clone for Training {
    fn clone(&self) -> Self {
        // Scratch memory is made again where needed.
        Self { n_steps: self.n_steps, moments: self.moments.clone(), ..Self::default() }
    }
}

/// Scratch and sums of one chunk of points.
#[derive(Debug)]
struct Chunk {
    /// Network inputs of one block, `[BLOCK][padded n_inputs]`; padding stays zero.
    x: Vec<f32>,
    /// Their gradients.
    d_x: Vec<f32>,
    /// Gradients of the features, `[level][point][feature]`.
    d_features: Vec<f32>,
    scratch: MlpScratch,
    gradient: MlpGradient,
    loss: f64,
}

impl<const D: usize> HashField<D> {
    /// One step of weighted regression; returns the loss before it, (1 / n k) Σ_i w_i Σ_o ρ(out_io − target_io), with ρ
    /// of [`super::TrainConfig::loss`].
    ///
    /// `targets[point][output]`, `weights[point]` (empty: all 1). The schedule counts the calls. A loss that is not finite
    /// means a target or weight is not, and the field is lost. No points: nothing happens, loss 0.
    ///
    /// # Panics
    /// If a length does not fit.
    pub fn train_step(&mut self, points: &[[f32; D]], targets: &[f32], weights: &[f32]) -> f64 {
        let k = self.n_outputs();
        assert_eq!(targets.len(), points.len() * k);
        assert!(weights.is_empty() || weights.len() == points.len());
        if points.is_empty() {
            return 0.0;
        }
        let Self { config, grid, mlp, params, packed, training } = self;
        let training = &mut **training.get_or_insert_default();
        training.resize(params.len(), mlp.n_params());
        let (table, network) = params.split_at_mut(grid.n_params());
        let Training { n_steps, moments, network_gradient, chunks, table: table_scratch } = training;
        let stride = padded(mlp.n_inputs);
        let n_chunks = points.len().div_ceil(CHUNK);
        if chunks.len() < n_chunks {
            chunks.resize_with(n_chunks, || Chunk {
                x: vec![0.0; BLOCK * stride],
                d_x: vec![0.0; BLOCK * stride],
                d_features: vec![0.0; CHUNK * grid.n_features()],
                scratch: MlpScratch::new(packed),
                gradient: MlpGradient::new(packed),
                loss: 0.0,
            });
        }
        let chunks = &mut chunks[..n_chunks];

        let scale = 1.0 / (points.len() * k) as f32;
        let tasks = chunks.par_iter_mut().zip(points.par_chunks(CHUNK)).zip(targets.par_chunks(CHUNK * k));
        tasks.enumerate().for_each(|(c, ((chunk, points), targets))| {
            let weights = if weights.is_empty() { weights } else { &weights[c * CHUNK..][..points.len()] };
            let loss = config.training.loss;
            let append = config.append_position;
            let table = &*table;
            Arch::new().dispatch(ChunkStep {
                grid,
                append,
                table,
                packed,
                loss,
                scale,
                points,
                targets,
                weights,
                chunk,
            });
        });
        let mut loss = 0.0;
        network_gradient.fill(0.0);
        for chunk in &*chunks {
            chunk.gradient.add_to(packed, network_gradient);
            loss += chunk.loss;
        }

        let part = |i: usize| {
            let points = &points[i * CHUNK..points.len().min((i + 1) * CHUNK)];
            let d = &chunks[i].d_features[..points.len() * grid.n_features()];
            Part { points, d, s: &[], u: [&[]; 3] }
        };
        let update = Update { settings: &config.training, grid, step: *n_steps, part: &part, n_parts: n_chunks };
        update.run(table, network, moments, network_gradient, table_scratch);
        packed.pack(network);
        *n_steps += 1;
        loss * scale as f64
    }

    /// Training steps done since the field was made or restored.
    pub fn n_steps(&self) -> u64 {
        self.training.as_ref().map_or(0, |t| t.n_steps)
    }

    /// Frees what only training needs (about three times the parameters). A later step starts a new schedule.
    pub fn finish_training(&mut self) {
        self.training = None;
    }
}

/// One step of the optimizer, once all gradients are known.
pub(crate) struct Update<'a, 'p, const D: usize> {
    pub(crate) settings: &'a TrainConfig,
    pub(crate) grid: &'a HashGrid<D>,
    pub(crate) step: u64,
    /// What the points' parts send back to the table.
    pub(crate) part: &'a (dyn Fn(usize) -> Part<'p, D> + Sync),
    pub(crate) n_parts: usize,
}

impl<const D: usize> Update<'_, '_, D> {
    /// Updates the table and the network; `moments` are those of both, one after the other.
    pub(crate) fn run(
        &self,
        table: &mut [f32],
        network: &mut [f32],
        moments: &mut MomentBuffers,
        network_gradient: &[f32],
        scratch: &Scratch,
    ) {
        let Self { settings, grid, step, part, n_parts } = *self;
        let factor = settings.schedule.factor(step);
        let (table_moments, network_moments) = moments.all().split_at(table.len());
        let learning_rate = settings.encoding_learning_rate * factor;
        TableStep { grid, part, n_parts, adam: &settings.adam, learning_rate, step, scratch }.run(table, table_moments);
        let rate = settings.network_learning_rate * factor;
        adam::cpu::step(&settings.adam, rate, step, network, network_moments, network_gradient);
    }
}

/// Forward, loss and backward of one chunk.
struct ChunkStep<'a, const D: usize> {
    grid: &'a HashGrid<D>,
    append: bool,
    table: &'a [f32],
    packed: &'a PackedMlp,
    loss: RegressionLoss,
    /// 1 / (points · outputs) of the whole step.
    scale: f32,
    points: &'a [[f32; D]],
    targets: &'a [f32],
    weights: &'a [f32],
    chunk: &'a mut Chunk,
}

impl<const D: usize> WithSimd for ChunkStep<'_, D> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { grid, append, table, packed, loss, scale, points, targets, weights, chunk } = self;
        let k = targets.len() / points.len();
        let Chunk { x, d_x, d_features, scratch, gradient, loss: chunk_loss } = chunk;
        let n_inputs = grid.n_features() + if append { D } else { 0 };
        let stride = padded(n_inputs);
        gradient.clear();
        *chunk_loss = 0.0;
        let mut features = Columns::new(grid, d_features, points.len());
        for (b, (block, targets)) in points.chunks(BLOCK).zip(targets.chunks(BLOCK * k)).enumerate() {
            hash_grid::encode_inlined(grid, table, block, 0, x, &mut [], stride);
            if append {
                append_positions(block, x, stride, grid.n_features());
            }
            mlp::forward_block(simd, packed, x, block.len(), scratch);
            let (outputs, d_outputs) = scratch.output_and_gradient();
            d_outputs.fill(0.0);
            let rows = outputs.chunks_exact(padded(k)).zip(d_outputs.chunks_exact_mut(padded(k)));
            for (p, ((y, d), target)) in rows.zip(targets.chunks_exact(k)).enumerate() {
                let weight = if weights.is_empty() { 1.0 } else { weights[b * BLOCK + p] };
                let mut sum = 0.0;
                for o in 0..k {
                    let (value, slope) = loss.at(y[o] - target[o]);
                    sum += value;
                    d[o] = scale * weight * slope;
                }
                *chunk_loss += (weight * sum) as f64;
            }
            mlp::backward_block(simd, packed, x, block.len(), scratch, Some(gradient), d_x);
            features.write(b * BLOCK, &d_x[..block.len() * stride], stride);
        }
    }
}

/// Writes points into the network's inputs after their features.
#[inline(always)]
pub(crate) fn append_positions<const D: usize>(points: &[[f32; D]], x: &mut [f32], stride: usize, column: usize) {
    for (point, x) in points.iter().zip(x.chunks_exact_mut(stride)) {
        x[column..column + D].copy_from_slice(point);
    }
}

/// Rows of features by point, turned into `[level][point][feature]`: each level's owner then reads only its own.
pub(crate) struct Columns<'a> {
    out: &'a mut [f32],
    n_points: usize,
    n_levels: usize,
    n_features: usize,
}

impl<'a> Columns<'a> {
    pub(crate) fn new<const D: usize>(grid: &HashGrid<D>, out: &'a mut [f32], n_points: usize) -> Self {
        Self { out, n_points, n_levels: grid.levels().len(), n_features: grid.config().n_features_per_level }
    }

    /// Rows of points from `first` on.
    #[inline(always)]
    pub(crate) fn write(&mut self, first: usize, rows: &[f32], stride: usize) {
        match self.n_features {
            1 => self.write_features::<1>(first, rows, stride),
            2 => self.write_features::<2>(first, rows, stride),
            4 => self.write_features::<4>(first, rows, stride),
            _ => self.write_features::<8>(first, rows, stride),
        }
    }

    #[inline(always)]
    fn write_features<const F: usize>(&mut self, first: usize, rows: &[f32], stride: usize) {
        let n = rows.len() / stride;
        let (out, _) = self.out.as_chunks_mut::<F>();
        for l in 0..self.n_levels {
            let out = &mut out[l * self.n_points + first..][..n];
            for (out, row) in out.iter_mut().zip(rows.chunks_exact(stride)) {
                out.copy_from_slice(&row[l * F..][..F]);
            }
        }
    }
}
