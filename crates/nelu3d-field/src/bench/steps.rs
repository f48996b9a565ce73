//! Training steps at named sizes, the same as in `benches/peer/surface_step.py`.

use super::{Accesses, Demand, LINE, RaySet};
use crate::encoding::hash_grid::{HashGrid, HashGridConfig};
use crate::field::{HashFieldConfig, TrainConfig};
use crate::surface::{NeuralSurface, SurfaceConfig, SurfaceLoss};
use std::collections::HashSet;

/// Batches a bench goes through in turn, so that none of them stays in a cache.
const N_BATCHES: u64 = 4;

/// Sizes of a training step.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct StepShape {
    /// Name.
    pub name: &'static str,
    /// Rays of a step.
    pub n_rays: usize,
    /// Samples of a ray.
    pub n_samples: usize,
    /// Length of the rays around the surface, in units of the volume.
    pub band: f32,
    /// Every how many samples the eikonal loss takes one.
    pub eikonal_every: usize,
    /// Levels of two features, from 16 cells up.
    pub n_levels: usize,
    /// Cells of the finest level.
    pub finest_resolution: u32,
    /// log2 of the entries of a level.
    pub log2_hashmap_size: u32,
    /// Hidden layers of 64 units.
    pub n_hidden_layers: usize,
}

/// Returns the steps that are measured.
pub fn steps() -> [StepShape; 3] {
    let full = StepShape {
        name: "full",
        n_rays: 1024,
        n_samples: 32,
        band: 1.0,
        eikonal_every: 8,
        n_levels: 16,
        finest_resolution: 2048,
        log2_hashmap_size: 19,
        n_hidden_layers: 2,
    };
    let narrow = StepShape { name: "narrow", n_samples: 16, band: 0.02, eikonal_every: 2, ..full };
    let small = StepShape {
        name: "narrow-small",
        n_levels: 12,
        finest_resolution: 512,
        log2_hashmap_size: 17,
        n_hidden_layers: 1,
        ..narrow
    };
    [full, narrow, small]
}

impl StepShape {
    /// Returns the surface that is trained.
    pub fn config(&self) -> SurfaceConfig {
        let encoding = HashGridConfig {
            n_levels: self.n_levels,
            n_features_per_level: 2,
            log2_hashmap_size: self.log2_hashmap_size,
            base_resolution: [16; 3],
            finest_resolution: [self.finest_resolution; 3],
        };
        let training =
            TrainConfig { encoding_learning_rate: 1e-3, network_learning_rate: 1e-3, ..TrainConfig::default() };
        let field = HashFieldConfig {
            encoding,
            width: 64,
            n_hidden_layers: self.n_hidden_layers,
            append_position: true,
            training,
            ..HashFieldConfig::small(1)
        };
        SurfaceConfig {
            field,
            extent: [1.0; 3],
            sharpness: 0.3,
            sharpness_learning_rate: 1e-3,
            loss: SurfaceLoss { eikonal_every: self.eikonal_every, ..SurfaceLoss::default() },
        }
    }

    /// Returns the number of points of one step.
    pub fn n_points(&self) -> usize {
        self.n_rays * self.n_samples
    }
}

/// A surface and batches to train it with.
pub struct SurfaceBench {
    surface: NeuralSurface,
    batches: Vec<RaySet>,
    next: usize,
}

impl SurfaceBench {
    /// Makes a benchmark for steps of this shape.
    ///
    /// # Panics
    /// If the shape is out of range.
    pub fn new(shape: &StepShape) -> Self {
        let surface = NeuralSurface::new(shape.config(), 0).expect("sizes in range");
        let batches = (0..N_BATCHES).map(|i| RaySet::new(shape.n_rays, shape.n_samples, shape.band, i)).collect();
        Self { surface, batches, next: 0 }
    }

    /// Takes one step; returns its loss.
    pub fn step(&mut self) -> f64 {
        let batch = &self.batches[self.next % self.batches.len()];
        self.next += 1;
        self.surface.train_step(&batch.batch(), &mut []).total
    }

    /// Returns what the phases of one step ask of the machine, one after the other: gather, network, compositing,
    /// scatter, optimizer.
    pub fn demands(&self) -> Vec<(&'static str, Demand)> {
        let batch = &self.batches[0];
        let n = batch.points().len();
        let every = self.surface.config().loss.eikonal_every;
        let n_eikonal = if every == 0 { 0 } else { n.div_ceil(every) };
        let grid = &self.surface.field().grid;
        let lines = LineCounts::of(grid, batch.points());
        let network = Demand { flops: self.surface.flops_per_step(n) as f64, ..Demand::default() };
        vec![
            ("gather", encode_demand(grid, &lines, n, n_eikonal)),
            ("network", network),
            ("compositing", Demand { exponentials: 2.0 * n as f64, ..Demand::default() }),
            ("scatter", scatter_demand(grid, &lines, n)),
            ("optimizer", adam_demand(&lines)),
        ]
    }
}

/// Cache lines of every level's table that a set of points touches, coarse to fine.
#[derive(Clone, Debug)]
pub struct LineCounts {
    /// By points one after the other: a line counts again for every point that needs it.
    pub by_point: Vec<f64>,
    /// At all.
    pub distinct: Vec<f64>,
}

impl LineCounts {
    /// Counts the lines of [`LINE`] bytes that the corners of the points' cells lie in; points in [0, 1]^3.
    pub fn of(grid: &HashGrid<3>, points: &[[f32; 3]]) -> Self {
        let per_line = LINE / (4 * grid.config().n_features_per_level);
        let mut counts = Self { by_point: Vec::new(), distinct: Vec::new() };
        for level in grid.levels() {
            let mut seen = HashSet::new();
            let mut n = 0;
            for x in points {
                let low: [u32; 3] = std::array::from_fn(|a| {
                    let resolution = level.resolution[a];
                    ((x[a] * resolution as f32) as u32).min(resolution - 1)
                });
                let corner = |c: usize| level.index(std::array::from_fn(|a| low[a] + (c >> a & 1) as u32)) / per_line;
                let mut lines: [usize; 8] = std::array::from_fn(corner);
                lines.sort_unstable();
                n += 1 + lines.windows(2).filter(|pair| pair[0] != pair[1]).count();
                seen.extend(lines);
            }
            counts.by_point.push(n as f64);
            counts.distinct.push(seen.len() as f64);
        }
        counts
    }
}

/// Bytes of one level's values.
fn level_bytes(grid: &HashGrid<3>, level: usize) -> usize {
    grid.levels()[level].n_entries * grid.config().n_features_per_level * 4
}

/// Bytes of the values of all levels up to this one: what is between two uses of a line. A step goes through all
/// levels, and the coarse ones are used most.
fn bytes_up_to(grid: &HashGrid<3>, level: usize) -> usize {
    (0..=level).map(|l| level_bytes(grid, l)).sum()
}

/// Returns the demand of the encoding: trilinear interpolation along three axes of F features: 7 differences and fused
/// multiply-adds, 9 more for the slopes.
pub(super) fn encode_demand(grid: &HashGrid<3>, lines: &LineCounts, n: usize, n_slopes: usize) -> Demand {
    let per_point = 3 * 7 * grid.n_features();
    let per_slope = (2 * 3 + 4 + 2 + 1) * grid.n_features();
    let reads = accesses(grid, lines, n, bytes_up_to);
    Demand { flops: (n * per_point + n_slopes * per_slope) as f64, reads, ..Demand::default() }
}

/// Returns the accesses of eight corners of every point at every level.
fn accesses(
    grid: &HashGrid<3>,
    lines: &LineCounts,
    n: usize,
    bytes: fn(&HashGrid<3>, usize) -> usize,
) -> Vec<Accesses> {
    let level = |(l, &lines): (usize, &f64)| Accesses { table_bytes: bytes(grid, l), n: 8.0 * n as f64, lines };
    lines.by_point.iter().enumerate().map(level).collect()
}

/// Returns the demand of the scatter: eight corners' factors and F fused multiply-adds each. All levels use one
/// gradient buffer in turn.
pub(super) fn scatter_demand(grid: &HashGrid<3>, lines: &LineCounts, n: usize) -> Demand {
    let flops = (n * (8 * 6 * grid.levels().len() + 8 * 2 * grid.n_features())) as f64;
    Demand { flops, updates: accesses(grid, lines, n, level_bytes), ..Demand::default() }
}

/// Returns the demand of the optimizer: parameters and both moments of every line that was touched are read and
/// written, in order; the gradient is still in a cache.
pub(super) fn adam_demand(lines: &LineCounts) -> Demand {
    let touched: f64 = lines.distinct.iter().sum();
    // 14 operations a parameter, a division and a square root among them.
    Demand { flops: 14.0 * 16.0 * touched, bytes: 3.0 * 2.0 * LINE as f64 * touched, ..Demand::default() }
}
