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
use crate::mlp::{MlpConfig, weight_norm};
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
    /// The network's raw parameters and their gradient, if they are not its weights.
    pub(crate) raw: [Vec<f32>; 2],
    chunks: Vec<Chunk>,
    pub(crate) table: Scratch,
}

impl Training {
    /// Gets ready to train these parameters.
    pub(crate) fn prepare(&mut self, settings: &TrainConfig, mlp: &MlpConfig, params: &[f32]) {
        let n_network = mlp.n_params();
        let mut n_raw = n_network;
        if settings.weight_normalization {
            n_raw = weight_norm::n_raw(mlp);
            if self.raw[0].len() != n_raw {
                self.raw[0] = weight_norm::from_weights(mlp, &params[params.len() - n_network..]);
                self.raw[1] = vec![0.0; n_raw];
            }
        }
        let n_moments = params.len() - n_network + n_raw;
        if self.moments.first.len() != n_moments {
            self.moments = MomentBuffers::new(n_moments);
        }
        self.network_gradient.resize(n_network, 0.0);
    }
}

impl Training {
    /// That of a training that was done elsewhere.
    #[cfg(feature = "gpu")]
    pub(crate) fn restored(n_steps: u64, moments: MomentBuffers, raw: Vec<f32>) -> Self {
        let d_raw = vec![0.0; raw.len()];
        Self { n_steps, moments, raw: [raw, d_raw], ..Self::default() }
    }
}

impl Clone for Training {
    fn clone(&self) -> Self {
        // Scratch memory is made again where needed.
        let (n_steps, moments, raw) = (self.n_steps, self.moments.clone(), self.raw.clone());
        Self { n_steps, moments, raw, ..Self::default() }
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
        assert!(weights.is_empty() || weights.len() == points.len());
        let loss = self.config.training.loss;
        let scale = 1.0 / (points.len() * self.n_outputs()).max(1) as f32;
        self.step(points, targets, Objective::Regression { loss, weights, scale }) * scale as f64
    }

    /// One step of the optimizer for a loss that is the caller's, given its gradient by the outputs, `[point][output]`. No
    /// points: nothing happens.
    ///
    /// # Panics
    /// If a length does not fit.
    pub fn descend(&mut self, points: &[[f32; D]], d_outputs: &[f32]) {
        self.step(points, d_outputs, Objective::Given);
    }

    /// One step; returns the sum over the points' losses. `per_output` has a target, or a gradient, per output.
    fn step(&mut self, points: &[[f32; D]], per_output: &[f32], objective: Objective) -> f64 {
        let k = self.n_outputs();
        assert_eq!(per_output.len(), points.len() * k);
        if points.is_empty() {
            return 0.0;
        }
        let Self { config, grid, mlp, params, packed, training } = self;
        let training = &mut **training.get_or_insert_default();
        training.prepare(&config.training, mlp, params);
        let (table, network) = params.split_at_mut(grid.n_params());
        let stride = padded(mlp.n_inputs);
        let n_chunks = points.len().div_ceil(CHUNK);
        if training.chunks.len() < n_chunks {
            training.chunks.resize_with(n_chunks, || Chunk {
                x: vec![0.0; BLOCK * stride],
                d_x: vec![0.0; BLOCK * stride],
                d_features: vec![0.0; CHUNK * grid.n_features()],
                scratch: MlpScratch::new(packed),
                gradient: MlpGradient::new(packed),
                loss: 0.0,
            });
        }
        let mut chunks = std::mem::take(&mut training.chunks);
        let parts = points.par_chunks(CHUNK).zip(per_output.par_chunks(CHUNK * k));
        chunks[..n_chunks].par_iter_mut().zip(parts).enumerate().for_each(|(c, (chunk, (points, per_output)))| {
            let objective = objective.part(c * CHUNK, points.len());
            let append = config.append_position;
            let table = &*table;
            Arch::new().dispatch(ChunkStep { grid, append, table, packed, objective, points, per_output, chunk });
        });
        let mut loss = 0.0;
        training.network_gradient.fill(0.0);
        for chunk in &chunks[..n_chunks] {
            chunk.gradient.add_to(packed, &mut training.network_gradient);
            loss += chunk.loss;
        }

        let part = |i: usize| {
            let points = &points[i * CHUNK..points.len().min((i + 1) * CHUNK)];
            let d = &chunks[i].d_features[..points.len() * grid.n_features()];
            Part { points, d, s: &[], u: [&[]; 3] }
        };
        Update { settings: &config.training, grid, mlp, part: &part, n_parts: n_chunks }.run(table, network, training);
        packed.pack(network);
        training.chunks = chunks;
        loss
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
    pub(crate) mlp: &'a MlpConfig,
    /// What the points' parts send back to the table.
    pub(crate) part: &'a (dyn Fn(usize) -> Part<'p, D> + Sync),
    pub(crate) n_parts: usize,
}

impl<const D: usize> Update<'_, '_, D> {
    /// Updates the table and the network, whose gradient `training` holds, and counts the step.
    pub(crate) fn run(&self, table: &mut [f32], network: &mut [f32], training: &mut Training) {
        let Self { settings, grid, mlp, part, n_parts } = *self;
        let Training { n_steps, moments, network_gradient, raw: [raw, d_raw], table: scratch, .. } = training;
        let step = *n_steps;
        let factor = settings.schedule.factor(step);
        let (table_moments, network_moments) = moments.all().split_at(table.len());
        let learning_rate = settings.encoding_learning_rate * factor;
        TableStep { grid, part, n_parts, adam: &settings.adam, learning_rate, step, scratch }.run(table, table_moments);
        let rate = settings.network_learning_rate * factor;
        if settings.weight_normalization {
            weight_norm::backward(mlp, raw, network_gradient, d_raw);
            adam::cpu::step(&settings.adam, rate, step, raw, network_moments, d_raw);
            weight_norm::to_weights(mlp, raw, network);
        } else {
            adam::cpu::step(&settings.adam, rate, step, network, network_moments, network_gradient);
        }
        *n_steps += 1;
    }
}

/// Where the gradient of the outputs comes from.
#[derive(Clone, Copy)]
enum Objective<'a> {
    /// scale · Σ_i w_i Σ_o ρ(out_io − target_io)
    Regression { loss: RegressionLoss, weights: &'a [f32], scale: f32 },
    /// From the caller.
    Given,
}

impl Objective<'_> {
    /// The same for `n` points from `first` on.
    fn part(self, first: usize, n: usize) -> Self {
        match self {
            Self::Regression { loss, weights, scale } if !weights.is_empty() => {
                Self::Regression { loss, weights: &weights[first..][..n], scale }
            }
            other => other,
        }
    }
}

/// Forward, loss and backward of one chunk.
struct ChunkStep<'a, const D: usize> {
    grid: &'a HashGrid<D>,
    append: bool,
    table: &'a [f32],
    packed: &'a PackedMlp,
    objective: Objective<'a>,
    points: &'a [[f32; D]],
    per_output: &'a [f32],
    chunk: &'a mut Chunk,
}

impl<const D: usize> WithSimd for ChunkStep<'_, D> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { grid, append, table, packed, objective, points, per_output, chunk } = self;
        let k = per_output.len() / points.len();
        let Chunk { x, d_x, d_features, scratch, gradient, loss: chunk_loss } = chunk;
        let n_inputs = grid.n_features() + if append { D } else { 0 };
        let stride = padded(n_inputs);
        gradient.clear();
        *chunk_loss = 0.0;
        let mut features = Columns::new(grid, d_features, points.len());
        for (b, (block, per_output)) in points.chunks(BLOCK).zip(per_output.chunks(BLOCK * k)).enumerate() {
            hash_grid::encode_inlined(grid, table, block, 0, x, &mut [], stride);
            if append {
                append_positions(block, x, stride, grid.n_features());
            }
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
