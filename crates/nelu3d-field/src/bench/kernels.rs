//! The kernels, each on its own.

use super::steps::{LineCounts, adam_demand, encode_demand, scatter_demand};
use super::{Case, Demand, RaySet, StepShape, steps};
use crate::adam::{self, AdamConfig, MomentBuffers, Moments};
use crate::encoding::frequency;
use crate::encoding::hash_grid::HashGrid;
use crate::encoding::hash_grid::cpu::{self as hash_grid, LINE};
use crate::memory;
use crate::mlp::cpu::{self as mlp, BLOCK, MlpGradient, PackedMlp, padded};
use crate::mlp::gradient::{self, GradientScratch};
use crate::mlp::{Activation, MlpConfig};
use crate::volrend::cpu as volrend;
use pulp::{Arch, Simd, WithSimd};
use std::hint::black_box;
use std::rc::Rc;

/// Returns all kernels. Encodings and the optimizer come at three sizes: the coarse levels alone, which a cache holds,
/// and the tables of the narrow-band and the full step.
pub fn kernels() -> Vec<Case> {
    let [full, narrow, small] = steps();
    let cached = StepShape { name: "cached", n_levels: 4, finest_resolution: 32, log2_hashmap_size: 15, ..narrow };
    let mut cases = network(&full);
    for shape in [cached, small, full] {
        cases.extend(encoding(&shape));
    }
    cases.push(compositing(&full));
    cases.push(frequencies());
    cases
}

fn uniform(n: usize, scale: f32) -> Vec<f32> {
    use rand::rngs::StdRng;
    use rand::{RngExt, SeedableRng};
    let mut rng = StdRng::seed_from_u64(3);
    (0..n).map(|_| scale * rng.random_range(-1.0..1.0)).collect()
}

fn network(shape: &StepShape) -> Vec<Case> {
    const N: usize = 8 * BLOCK;
    let n_inputs = 2 * shape.n_levels + 3;
    let config = MlpConfig {
        n_inputs,
        n_outputs: 1,
        width: 64,
        n_hidden_layers: shape.n_hidden_layers,
        output_activation: Activation::Linear,
    };
    let mut params = vec![0.0; config.n_params()];
    config.init(1, &mut params);
    let packed = Rc::new(PackedMlp::new(&config, &params));
    let flops = config.layers().map(|(n_in, n_out)| 2 * n_in * n_out).sum::<usize>() as f64;
    let x = uniform(N * n_inputs, 0.5);
    let mut out = vec![0.0; N];
    let case = |name: &str, passes: f64, run: Box<dyn FnMut()>| Case {
        name: format!("network {n_inputs}-64-64-1, {name}"),
        points: N,
        demand: Demand { flops: passes * flops * N as f64, ..Demand::default() },
        run,
    };
    let forward = {
        let packed = packed.clone();
        move || mlp::forward(&packed, black_box(&x), &mut out)
    };
    let mut block = SurfaceBlock {
        x: uniform(BLOCK * padded(n_inputs), 0.5),
        work: vec![0.0; BLOCK * padded(n_inputs)],
        s: uniform(BLOCK, 1.0),
        y: vec![0.0; BLOCK],
        d_x: vec![0.0; BLOCK * padded(n_inputs)],
        v: uniform(BLOCK * padded(n_inputs), 1.0),
        every: 2,
        scratch: GradientScratch::default(),
        gradient: MlpGradient::new(&packed),
        packed: packed.clone(),
    };
    block.scratch.reserve(&packed, BLOCK);
    let step = move || {
        for _ in 0..N / BLOCK {
            Arch::new().dispatch(&mut block);
        }
    };
    vec![case("value", 1.0, Box::new(forward)), case("step with slopes on half", 3.5, Box::new(step))]
}

/// Value, gradient and all backward passes of one block.
struct SurfaceBlock {
    packed: Rc<PackedMlp>,
    x: Vec<f32>,
    work: Vec<f32>,
    s: Vec<f32>,
    y: Vec<f32>,
    d_x: Vec<f32>,
    v: Vec<f32>,
    every: usize,
    scratch: GradientScratch,
    gradient: MlpGradient,
}

impl WithSimd for &mut SurfaceBlock {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.work.copy_from_slice(&self.x);
        gradient::forward(simd, &self.packed, &self.work, BLOCK, &mut self.scratch, &mut self.y, &mut self.d_x);
        let SurfaceBlock { packed, work, s, every, v, scratch, gradient, .. } = self;
        gradient::accumulate(simd, packed, work, s, *every, v, scratch, gradient);
    }
}

/// Inputs of the cases of a hash grid.
struct EncodingCase {
    name: &'static str,
    grid: Rc<HashGrid<3>>,
    points: Rc<[[f32; 3]]>,
    lines: LineCounts,
    table: Vec<f32>,
    /// Gradients of one level's features.
    d: Vec<f32>,
}

/// Returns the cases of a table: gather, scatter and optimizer.
fn encoding(shape: &StepShape) -> Vec<Case> {
    let grid = Rc::new(HashGrid::new(&shape.config().field.encoding).expect("sizes in range"));
    let rays = RaySet::new(shape.n_rays, shape.n_samples, shape.band, 1);
    let lines = LineCounts::of(&grid, rays.points());
    let points: Rc<[[f32; 3]]> = rays.points().into();
    let mut table = memory::zeros(grid.n_params());
    grid.init(1, &mut table);
    let d = uniform(points.len() * grid.config().n_features_per_level, 1e-3);
    let case = EncodingCase { name: shape.name, grid, points, lines, table, d };
    // Memory in the same order as ever, so that pages lie as they did when older numbers were taken.
    let (scatter, optimizer) = (case.scatter(), case.optimizer());
    vec![case.gather("gather", 0), case.gather("gather with slopes of half", 2), scatter, optimizer]
}

impl EncodingCase {
    fn case(&self, what: &str, demand: Demand, run: impl FnMut() + 'static) -> Case {
        Case { name: format!("{what}, {}", self.name), points: self.points.len(), demand, run: Box::new(run) }
    }

    /// Makes a gradient and its marks, large enough for any level: as in a step, all levels use one buffer in turn.
    fn buffer(&self) -> (Vec<f32>, Vec<u8>) {
        let n_features = self.grid.config().n_features_per_level;
        let largest = self.grid.levels().iter().map(|level| level.n_entries * n_features).max().unwrap_or(0);
        (memory::zeros(largest), vec![0u8; largest.div_ceil(LINE)])
    }

    fn gather(&self, what: &str, every: usize) -> Case {
        let (grid, points, table, n) = (self.grid.clone(), self.points.clone(), self.table.clone(), self.points.len());
        let mut out = vec![0.0; n * grid.n_features()];
        let n_slopes = if every == 0 { 0 } else { n.div_ceil(every) };
        let mut jacobian = vec![0.0; n_slopes * 3 * grid.n_features()];
        self.case(what, encode_demand(&self.grid, &self.lines, n, n_slopes), move || {
            hash_grid::forward_with_jacobian(&grid, &table, &points, every, &mut out, &mut jacobian);
        })
    }

    fn scatter(&self) -> Case {
        let (grid, points, d) = (self.grid.clone(), self.points.clone(), self.d.clone());
        let u: Vec<f32> = uniform(points.len(), 1e-3);
        let n_features = grid.config().n_features_per_level;
        let (mut gradient, mut touched) = self.buffer();
        self.case("scatter with slopes", scatter_demand(&self.grid, &self.lines, points.len()), move || {
            let incoming = hash_grid::Incoming { d: &d, s: &u, u: [&u; 3] };
            for (l, level) in grid.levels().iter().enumerate() {
                let n = level.n_entries * n_features;
                let (gradient, touched) = (&mut gradient[..n], &mut touched[..n.div_ceil(LINE)]);
                hash_grid::scatter(&grid, l, &points, incoming, 0..level.n_entries, gradient, touched);
            }
        })
    }

    /// Returns the lines of a level that the points touch.
    fn marks(&self, level: usize) -> Vec<u8> {
        let (mut gradient, mut touched) = self.buffer();
        let n_entries = self.grid.levels()[level].n_entries;
        let incoming = hash_grid::Incoming { d: &self.d, s: &[], u: [&[]; 3] };
        let range = 0..n_entries;
        hash_grid::scatter(&self.grid, level, &self.points, incoming, range, &mut gradient, &mut touched);
        touched.truncate((n_entries * self.grid.config().n_features_per_level).div_ceil(LINE));
        touched
    }

    fn optimizer(&self) -> Case {
        // The lines are marked again before each step. Their gradients stay zero, so that there is nothing else to
        // prepare: what is done to a line does not depend on them.
        let marks: Vec<Vec<u8>> = (0..self.grid.levels().len()).map(|l| self.marks(l)).collect();
        let (mut params, grid) = (self.table.clone(), self.grid.clone());
        let (mut gradient, mut touched) = self.buffer();
        let mut moments = MomentBuffers::new(params.len());
        let config = AdamConfig::default();
        let n_features = grid.config().n_features_per_level;
        self.case("lazy Adam", adam_demand(&self.lines), move || {
            for (level, marks) in grid.levels().iter().zip(&marks) {
                let range = level.offset * n_features..(level.offset + level.n_entries) * n_features;
                let touched = &mut touched[..marks.len()];
                touched.copy_from_slice(marks);
                let moments =
                    Moments { first: &mut moments.first[range.clone()], second: &mut moments.second[range.clone()] };
                let gradient = &mut gradient[..range.len()];
                adam::cpu::step_lazy(&config, 1e-4, 100, &mut params[range], moments, gradient, touched);
            }
        })
    }
}

fn compositing(shape: &StepShape) -> Case {
    let rays = RaySet::new(shape.n_rays, shape.n_samples, 0.02, 1);
    let n = rays.points().len();
    let offsets = rays.offsets().to_vec();
    let sdf: Vec<f32> =
        rays.points().iter().map(|[x, y, z]| 0.5 + 0.1 * (6.0 * x).sin() * (5.0 * y).cos() - z).collect();
    let (mut weights, mut d_sdf, d_weights) = (vec![0.0; n], vec![0.0; n], uniform(n, 1.0));
    let mut steps = Vec::new();
    Case {
        name: "compositing, forward and backward".into(),
        points: n,
        demand: Demand { exponentials: 2.0 * n as f64, ..Demand::default() },
        run: Box::new(move || {
            for ray in offsets.windows(2).map(|r| r[0]..r[1]) {
                let (sdf, weights) = (&sdf[ray.clone()], &mut weights[ray.clone()]);
                volrend::forward_ray(sdf, 200.0, weights, &mut steps);
                black_box(volrend::backward_ray(
                    sdf,
                    200.0,
                    weights,
                    &steps,
                    &d_weights[ray.clone()],
                    0.0,
                    &mut d_sdf[ray],
                ));
            }
        }),
    }
}

fn frequencies() -> Case {
    const N: usize = 4096;
    const N_FREQUENCIES: usize = 20;
    let points = uniform(3 * N, 1.0);
    let encoding = frequency::Frequency { n_frequencies: N_FREQUENCIES };
    let mut out = vec![0.0; N * encoding.n_features(3)];
    Case {
        name: "frequency encoding, 20 octaves".into(),
        points: N,
        // Two polynomials, and the argument's reduction.
        demand: Demand { flops: (30 * N * 3 * N_FREQUENCIES) as f64, ..Demand::default() },
        run: Box::new(move || frequency::cpu::forward(encoding, points.as_chunks::<3>().0, &mut out)),
    }
}
