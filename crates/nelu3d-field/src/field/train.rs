//! One training step: weighted regression of the outputs on targets.
//!
//! Points are cut into chunks of fixed size; a chunk sums its own network gradient, and the chunks' sums are added in
//! order. Then every level of the table is owned by one task, which scatters all points' gradients into it and updates
//! the entries it touched. Neither depends on the number of threads.

use super::{HashField, RegressionLoss};
use crate::adam::{self, Moments};
use crate::encoding::hash_grid::{HashGrid, cpu as hash_grid};
use crate::mlp::cpu::{self as mlp, BLOCK, MlpGradient, MlpScratch, PackedMlp, padded};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::sync::Mutex;

/// Points whose network gradients are summed before anything else: fixed, so that sums do not depend on threads.
const CHUNK: usize = 8 * BLOCK;

/// What training needs beside the parameters.
#[derive(Debug, Default)]
pub(super) struct Training {
    /// Steps done.
    n_steps: u64,
    moments: Vec<Moments>,
    network_gradient: Vec<f32>,
    chunks: Vec<Chunk>,
    /// Features of every point, then their gradients in the same place: `[point][padded n_features]`.
    features: Vec<f32>,
    /// As many as levels were ever updated at once.
    scatter: Mutex<Vec<Scatter>>,
}

impl Clone for Training {
    fn clone(&self) -> Self {
        Self {
            n_steps: self.n_steps,
            moments: self.moments.clone(),
            network_gradient: self.network_gradient.clone(),
            // Scratch memory: made again where needed.
            ..Self::default()
        }
    }
}

/// Scratch and sums of one chunk of points.
#[derive(Debug)]
struct Chunk {
    scratch: MlpScratch,
    gradient: MlpGradient,
    loss: f64,
}

/// Gradient of one level, zero between uses.
#[derive(Debug, Default)]
struct Scatter {
    gradient: Vec<f32>,
    touched: Vec<u64>,
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
        let (table, network) = params.split_at_mut(grid.n_params());
        let stride = padded(grid.n_features());
        let training = training.get_or_insert_default();
        let Training { n_steps, moments, network_gradient, chunks, features, scatter } = &mut **training;
        moments.resize(table.len() + network.len(), [0.0; 2]);
        network_gradient.resize(network.len(), 0.0);
        let n_chunks = points.len().div_ceil(CHUNK);
        if chunks.len() < n_chunks {
            chunks.resize_with(n_chunks, || Chunk {
                scratch: MlpScratch::new(packed),
                gradient: MlpGradient::new(packed),
                loss: 0.0,
            });
        }
        // Whole blocks, so that the last one's padding rows have a place.
        let n_rows = points.len().next_multiple_of(BLOCK);
        if features.len() < n_rows * stride {
            features.resize(n_rows * stride, 0.0);
        }
        let features = &mut features[..n_rows * stride];

        let scale = 1.0 / (points.len() * k) as f32;
        let tasks = chunks.par_iter_mut().zip(points.par_chunks(CHUNK)).zip(targets.par_chunks(CHUNK * k));
        tasks.zip(features.par_chunks_mut(CHUNK * stride)).enumerate().for_each(
            |(c, (((chunk, points), targets), features))| {
                let weights = if weights.is_empty() { weights } else { &weights[c * CHUNK..][..points.len()] };
                let loss = config.training.loss;
                let table = &*table;
                let step = ChunkStep { grid, table, packed, loss, scale, points, targets, weights, features, chunk };
                Arch::new().dispatch(step);
            },
        );
        let mut loss = 0.0;
        network_gradient.fill(0.0);
        for chunk in &chunks[..n_chunks] {
            chunk.gradient.add_to(packed, network_gradient);
            loss += chunk.loss;
        }

        let settings = &config.training;
        let factor = settings.schedule.factor(*n_steps);
        let (table_moments, network_moments) = moments.split_at_mut(table.len());
        let update = LevelUpdate {
            grid,
            points,
            d_features: features,
            stride,
            adam: &settings.adam,
            learning_rate: settings.encoding_learning_rate * factor,
            step: *n_steps,
            scatter,
        };
        update.levels(0..grid.levels().len(), table, table_moments);
        let rate = settings.network_learning_rate * factor;
        adam::cpu::step(&settings.adam, rate, *n_steps, network, network_moments, network_gradient);
        packed.pack(network);
        debug_assert_eq!(mlp.n_params(), network.len());
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

/// Forward, loss and backward of one chunk.
struct ChunkStep<'a, const D: usize> {
    grid: &'a HashGrid<D>,
    table: &'a [f32],
    packed: &'a PackedMlp,
    loss: RegressionLoss,
    /// 1 / (points · outputs) of the whole step.
    scale: f32,
    points: &'a [[f32; D]],
    targets: &'a [f32],
    weights: &'a [f32],
    features: &'a mut [f32],
    chunk: &'a mut Chunk,
}

impl<const D: usize> WithSimd for ChunkStep<'_, D> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { grid, table, packed, loss, scale, points, targets, weights, features, chunk } = self;
        let k = targets.len() / points.len();
        let stride = padded(grid.n_features());
        chunk.gradient.clear();
        chunk.loss = 0.0;
        let mut x = [0.0f32; BLOCK * 256];
        let x = &mut x[..BLOCK * stride];
        let blocks = points.chunks(BLOCK).zip(targets.chunks(BLOCK * k)).zip(features.chunks_mut(BLOCK * stride));
        for (b, ((points, targets), d_features)) in blocks.enumerate() {
            hash_grid::forward_inlined(grid, table, points, x, stride);
            mlp::forward_block(simd, packed, x, points.len(), &mut chunk.scratch);
            let (outputs, d_outputs) = chunk.scratch.output_and_gradient();
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
                chunk.loss += (weight * sum) as f64;
            }
            mlp::backward_block(
                simd,
                packed,
                x,
                points.len(),
                &mut chunk.scratch,
                Some(&mut chunk.gradient),
                d_features,
            );
        }
    }
}

/// Scatter and lazy update of the table.
struct LevelUpdate<'a, const D: usize> {
    grid: &'a HashGrid<D>,
    points: &'a [[f32; D]],
    d_features: &'a [f32],
    stride: usize,
    adam: &'a adam::AdamConfig,
    learning_rate: f64,
    step: u64,
    scatter: &'a Mutex<Vec<Scatter>>,
}

impl<const D: usize> LevelUpdate<'_, D> {
    /// Splits the levels, and their parameters with them, until each has its own task.
    fn levels(&self, levels: std::ops::Range<usize>, table: &mut [f32], moments: &mut [Moments]) {
        if levels.len() == 1 {
            return self.level(levels.start, table, moments);
        }
        let middle = levels.start + levels.len() / 2;
        let all = self.grid.levels();
        let n_entries = all[middle].offset - all[levels.start].offset;
        let at = n_entries * self.grid.config().n_features_per_level;
        let (left, right) = table.split_at_mut(at);
        let (left_moments, right_moments) = moments.split_at_mut(at);
        rayon::join(
            || self.levels(levels.start..middle, left, left_moments),
            || self.levels(middle..levels.end, right, right_moments),
        );
    }

    fn level(&self, level: usize, table: &mut [f32], moments: &mut [Moments]) {
        let lock = || self.scatter.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let mut buffers = lock().pop().unwrap_or_default();
        let n_entries = self.grid.levels()[level].n_entries;
        if buffers.gradient.len() < table.len() {
            buffers.gradient.resize(table.len(), 0.0);
            buffers.touched.resize(n_entries.div_ceil(64), 0);
        }
        let gradient = &mut buffers.gradient[..table.len()];
        let touched = &mut buffers.touched[..n_entries.div_ceil(64)];
        hash_grid::scatter(self.grid, level, self.points, self.d_features, self.stride, gradient, touched);
        let n_features = self.grid.config().n_features_per_level;
        let (adam, rate) = (self.adam, self.learning_rate);
        adam::cpu::step_lazy(adam, rate, self.step, n_features, table, moments, gradient, touched);
        lock().push(buffers);
    }
}
