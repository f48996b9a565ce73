//! Frequency encoding and a network: the field of NeRF (Mildenhall et al. 2020, Sec. 5.1), with as many octaves per axis as
//! wanted. All it knows is in the network, so every step touches every parameter.

use super::{FieldError, RegressionLoss};
use crate::adam::{self, AdamConfig, MomentBuffers, Schedule};
use crate::encoding::frequency::{self, Frequency};
use crate::mlp::cpu::{self as mlp, BLOCK, MlpGradient, MlpScratch, PackedMlp, padded};
use crate::mlp::{Activation, MlpConfig};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Points whose gradients are summed before anything else: fixed, so that sums do not depend on threads.
const CHUNK: usize = 8 * BLOCK;
/// Octaves beyond which single-precision points no longer vary within a period.
const MAX_OCTAVES: usize = 24;

/// Everything that determines a field apart from its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrequencyFieldConfig {
    /// Octaves of each axis, at most 24; an axis of 0 is only seen as the point's own coordinate.
    pub n_frequencies: [usize; 3],
    /// Length of an output vector, k.
    pub n_outputs: usize,
    /// Units of a hidden layer.
    pub width: usize,
    /// Number of hidden layers.
    pub n_hidden_layers: usize,
    /// Loss of a residual.
    #[serde(default)]
    pub loss: RegressionLoss,
    /// Optimizer.
    #[serde(default)]
    pub adam: AdamConfig,
    /// Learning rate.
    pub learning_rate: f64,
    /// Factor on it, by step.
    #[serde(default)]
    pub schedule: Schedule,
}

impl FrequencyFieldConfig {
    /// The paper's encoding: 20 octaves on every axis.
    pub fn paper(n_outputs: usize) -> Self {
        Self {
            n_frequencies: [20; 3],
            n_outputs,
            width: 128,
            n_hidden_layers: 4,
            loss: RegressionLoss::L2,
            adam: AdamConfig::default(),
            learning_rate: 2e-3,
            schedule: Schedule::default(),
        }
    }

    /// Features of a point: per axis and octave sine and cosine, then the point itself.
    fn n_inputs(&self) -> usize {
        2 * self.n_frequencies.iter().map(|n| (*n).min(MAX_OCTAVES)).sum::<usize>() + 3
    }

    fn build(&self) -> Result<MlpConfig, FieldError> {
        let mlp = MlpConfig {
            n_inputs: self.n_inputs(),
            n_outputs: self.n_outputs,
            width: self.width,
            n_hidden_layers: self.n_hidden_layers,
            output_activation: Activation::Linear,
        };
        mlp.validate()?;
        Ok(mlp)
    }
}

/// A learned function [0, 1]^3 → R^k.
#[derive(Clone, Debug)]
pub struct FrequencyField {
    config: FrequencyFieldConfig,
    mlp: MlpConfig,
    params: Vec<f32>,
    packed: PackedMlp,
    training: Option<Box<Training>>,
}

#[derive(Clone, Debug, Default)]
struct Training {
    n_steps: u64,
    moments: MomentBuffers,
    gradient: Vec<f32>,
    chunks: Vec<Chunk>,
}

/// Scratch and sums of one chunk of points.
#[derive(Clone, Debug)]
struct Chunk {
    inputs: Inputs,
    /// Gradients of the inputs, which nothing needs.
    d_x: Vec<f32>,
    scratch: MlpScratch,
    gradient: MlpGradient,
    loss: f64,
}

impl FrequencyField {
    /// A field with random parameters.
    ///
    /// # Errors
    /// [`FieldError`] for a configuration out of range.
    pub fn new(config: FrequencyFieldConfig, seed: u64) -> Result<Self, FieldError> {
        let mlp = config.build()?;
        let mut params = vec![0.0; mlp.n_params()];
        mlp.init(seed, &mut params);
        Self::from_params(config, params)
    }

    /// A field with given parameters, those of the network (see [`crate::mlp`]).
    ///
    /// # Errors
    /// [`FieldError`] for a configuration out of range, parameters of another length, or one that is not finite.
    pub fn from_params(config: FrequencyFieldConfig, params: Vec<f32>) -> Result<Self, FieldError> {
        let mlp = config.build()?;
        if params.len() != mlp.n_params() {
            return Err(FieldError::Length { expected: mlp.n_params(), found: params.len() });
        }
        if let Some(index) = params.iter().position(|x| !x.is_finite()) {
            return Err(FieldError::NotFinite { index });
        }
        let packed = PackedMlp::new(&mlp, &params);
        Ok(Self { config, mlp, params, packed, training: None })
    }

    /// The configuration.
    pub fn config(&self) -> &FrequencyFieldConfig {
        &self.config
    }

    /// All parameters.
    pub fn params(&self) -> &[f32] {
        &self.params
    }

    /// Length of an output vector, k.
    pub fn n_outputs(&self) -> usize {
        self.mlp.n_outputs
    }

    /// One step of weighted regression; returns the loss before it. As [`super::HashField::train_step`].
    ///
    /// # Panics
    /// If a length does not fit.
    pub fn train_step(&mut self, points: &[[f32; 3]], targets: &[f32], weights: &[f32]) -> f64 {
        let k = self.n_outputs();
        assert_eq!(targets.len(), points.len() * k);
        assert!(weights.is_empty() || weights.len() == points.len());
        if points.is_empty() {
            return 0.0;
        }
        let Self { config, mlp, params, packed, training } = self;
        let Training { n_steps, moments, gradient, chunks } = &mut **training.get_or_insert_default();
        if gradient.len() != params.len() {
            *moments = MomentBuffers::new(params.len());
            gradient.resize(params.len(), 0.0);
        }
        let n_chunks = points.len().div_ceil(CHUNK);
        while chunks.len() < n_chunks {
            chunks.push(Chunk {
                inputs: Inputs::new(config, mlp),
                d_x: vec![0.0; BLOCK * padded(mlp.n_inputs)],
                scratch: MlpScratch::new(packed),
                gradient: MlpGradient::new(packed),
                loss: 0.0,
            });
        }
        let scale = 1.0 / (points.len() * k) as f32;
        let tasks = chunks[..n_chunks].par_iter_mut().zip(points.par_chunks(CHUNK)).zip(targets.par_chunks(CHUNK * k));
        tasks.enumerate().for_each(|(c, ((chunk, points), targets))| {
            let weights = if weights.is_empty() { weights } else { &weights[c * CHUNK..][..points.len()] };
            Arch::new().dispatch(ChunkStep { loss: config.loss, packed, scale, points, targets, weights, chunk });
        });
        gradient.fill(0.0);
        let mut loss = 0.0;
        for chunk in &chunks[..n_chunks] {
            chunk.gradient.add_to(packed, gradient);
            loss += chunk.loss;
        }
        let rate = config.learning_rate * config.schedule.factor(*n_steps);
        adam::cpu::step(&config.adam, rate, *n_steps, params, moments.all(), gradient);
        packed.pack(params);
        *n_steps += 1;
        loss * f64::from(scale)
    }

    /// Frees what only training needs. A later step starts a new schedule.
    pub fn finish_training(&mut self) {
        self.training = None;
    }

    /// Outputs of many points, in parallel: `out[point][output]`.
    ///
    /// # Panics
    /// If `out` does not hold `n_outputs` values per point.
    pub fn query(&self, points: &[[f32; 3]], out: &mut [f32]) {
        const TASK: usize = 32 * BLOCK;
        let k = self.n_outputs();
        assert_eq!(out.len(), points.len() * k);
        points.par_chunks(TASK).zip(out.par_chunks_mut(TASK * k)).for_each(|(points, out)| {
            Arch::new().dispatch(Query { field: self, points, out });
        });
    }
}

/// Network inputs of one block.
#[derive(Clone, Debug)]
struct Inputs {
    encoding: Frequency,
    n_frequencies: [usize; 3],
    /// Features of all axes with as many octaves as the one that has most.
    all: Vec<f32>,
    /// `[BLOCK][padded n_inputs]`; padding stays zero.
    x: Vec<f32>,
    stride: usize,
}

impl Inputs {
    fn new(config: &FrequencyFieldConfig, mlp: &MlpConfig) -> Self {
        let n_frequencies = config.n_frequencies.map(|n| n.min(MAX_OCTAVES));
        let encoding = Frequency { n_frequencies: n_frequencies.into_iter().max().unwrap_or(0) };
        let stride = padded(mlp.n_inputs);
        Self {
            encoding,
            n_frequencies,
            all: vec![0.0; BLOCK * encoding.n_features(3)],
            x: vec![0.0; BLOCK * stride],
            stride,
        }
    }

    /// Encodes at most a block of points.
    fn encode(&mut self, points: &[[f32; 3]]) {
        let n = self.encoding.n_features(3);
        frequency::cpu::forward(self.encoding, points, &mut self.all[..points.len() * n]);
        for (i, (point, x)) in points.iter().zip(self.x.chunks_exact_mut(self.stride)).enumerate() {
            let mut column = 0;
            for (axis, octaves) in self.n_frequencies.iter().enumerate() {
                let from = i * n + 2 * axis * self.encoding.n_frequencies;
                x[column..column + 2 * octaves].copy_from_slice(&self.all[from..from + 2 * octaves]);
                column += 2 * octaves;
            }
            x[column..column + 3].copy_from_slice(point);
        }
    }
}

/// Forward, loss and backward of one chunk.
struct ChunkStep<'a> {
    loss: RegressionLoss,
    packed: &'a PackedMlp,
    /// 1 / (points · outputs) of the whole step.
    scale: f32,
    points: &'a [[f32; 3]],
    targets: &'a [f32],
    weights: &'a [f32],
    chunk: &'a mut Chunk,
}

impl WithSimd for ChunkStep<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { loss, packed, scale, points, targets, weights, chunk } = self;
        let k = targets.len() / points.len();
        let Chunk { inputs, d_x, scratch, gradient, loss: sum } = chunk;
        gradient.clear();
        *sum = 0.0;
        for (b, (block, targets)) in points.chunks(BLOCK).zip(targets.chunks(BLOCK * k)).enumerate() {
            inputs.encode(block);
            mlp::forward_block(simd, packed, &inputs.x, block.len(), scratch);
            let (outputs, d_outputs) = scratch.output_and_gradient();
            d_outputs.fill(0.0);
            let rows = outputs.chunks_exact(padded(k)).zip(d_outputs.chunks_exact_mut(padded(k)));
            for (p, ((y, d), target)) in rows.zip(targets.chunks_exact(k)).enumerate() {
                let weight = if weights.is_empty() { 1.0 } else { weights[b * BLOCK + p] };
                for o in 0..k {
                    let (value, slope) = loss.at(y[o] - target[o]);
                    *sum += f64::from(weight * value);
                    d[o] = scale * weight * slope;
                }
            }
            mlp::backward_block(simd, packed, &inputs.x, block.len(), scratch, Some(gradient), d_x);
        }
    }
}

struct Query<'a> {
    field: &'a FrequencyField,
    points: &'a [[f32; 3]],
    out: &'a mut [f32],
}

impl WithSimd for Query<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let FrequencyField { config, mlp, packed, .. } = self.field;
        let k = mlp.n_outputs;
        let (mut inputs, mut scratch) = (Inputs::new(config, mlp), MlpScratch::new(packed));
        for (points, out) in self.points.chunks(BLOCK).zip(self.out.chunks_mut(BLOCK * k)) {
            inputs.encode(points);
            mlp::forward_block(simd, packed, &inputs.x, points.len(), &mut scratch);
            for (y, out) in scratch.output().chunks_exact(padded(k)).zip(out.chunks_exact_mut(k)) {
                out.copy_from_slice(&y[..k]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::uniform_f32;
    use crate::encoding::frequency;
    use crate::mlp;

    fn points(seed: u64, n: usize) -> Vec<[f32; 3]> {
        uniform_f32(seed, 3 * n, 0.0, 1.0).as_chunks::<3>().0.to_vec()
    }

    fn small() -> FrequencyFieldConfig {
        FrequencyFieldConfig {
            n_frequencies: [5, 3, 1],
            width: 32,
            n_hidden_layers: 2,
            ..FrequencyFieldConfig::paper(2)
        }
    }

    #[test]
    fn a_query_is_the_reference_network_of_the_reference_encoding() {
        let field = FrequencyField::new(small(), 3).unwrap();
        let points = points(1, 200);
        let mut out = vec![0.0; 2 * points.len()];
        field.query(&points, &mut out);
        for (x, y) in points.iter().zip(out.chunks_exact(2)) {
            let x = x.map(f64::from);
            let mut features = Vec::new();
            for (a, n) in small().n_frequencies.into_iter().enumerate() {
                let encoding = Frequency { n_frequencies: n };
                let mut all = vec![0.0; encoding.n_features(3)];
                frequency::reference::forward(encoding, x, &mut all);
                features.extend_from_slice(&all[2 * n * a..2 * n * (a + 1)]);
            }
            features.extend_from_slice(&x);
            let params: Vec<f64> = field.params().iter().map(|p| f64::from(*p)).collect();
            let mut exact = [0.0; 2];
            mlp::reference::forward(&field.mlp, &params, &features, &mut exact);
            for (a, b) in y.iter().zip(exact) {
                assert!((f64::from(*a) - b).abs() < 1e-5, "{a} {b}");
            }
        }
    }

    #[test]
    fn it_learns_fringes() {
        let truth = |q: &[f32; 3]| [(14.0 * q[0]).sin(), (6.0 * q[1]).cos() * (0.5 + 0.5 * q[2])];
        let mut config = small();
        config.schedule.n_steps = 2000;
        let mut field = FrequencyField::new(config, 7).unwrap();
        let mut loss = 0.0;
        for step in 0..2000 {
            let p = points(100 + step, 1000);
            let t: Vec<f32> = p.iter().flat_map(truth).collect();
            loss = field.train_step(&p, &t, &[]);
        }
        field.finish_training();
        assert!(loss < 3e-3, "{loss}");
        let again = FrequencyField::from_params(field.config().clone(), field.params().to_vec()).unwrap();
        let p = points(5, 50);
        let (mut a, mut b) = (vec![0.0; 100], vec![0.0; 100]);
        field.query(&p, &mut a);
        again.query(&p, &mut b);
        assert_eq!(a, b);
    }

    #[test]
    fn impossible_fields_are_refused() {
        let wide = FrequencyFieldConfig { width: 1000, ..small() };
        assert!(matches!(FrequencyField::new(wide, 1), Err(FieldError::Network(_))));
        let params = FrequencyField::new(small(), 1).unwrap().params().to_vec();
        assert!(FrequencyField::from_params(small(), params[1..].to_vec()).is_err());
        let many = FrequencyFieldConfig { n_frequencies: [usize::MAX; 3], ..small() };
        let many = FrequencyField::new(many, 1).unwrap();
        assert_eq!(many.mlp.n_inputs, 3 * 2 * 24 + 3);
    }
}
