//! The `hash` form: a multiresolution hash encoding and a small network over the unit cube of a
//! [`Frame`](super::frame::Frame).
//!
//! The published form uses isotropic levels up to 2048 cells in camera coordinates; levels finer than the sweep's step
//! are never supervised between board positions and put wiggles there. Here the levels are anisotropic and live in the
//! field's frame: fine across, and along w no finer than what the sweep supervises.

use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::{HashField, HashFieldConfig};
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use super::grid::{Bins, Grid};
use crate::progress::Progress;

/// Settings of a [`HashForm`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HashSettings {
    /// Cells of the volume along a, b and w: bounds the finest level.
    pub cells: [usize; 3],
    /// Levels.
    pub n_levels: usize,
    /// log2 of the table's entries per level.
    pub log2_hashmap_size: u32,
    /// Units of a hidden layer.
    pub width: usize,
    /// Training steps.
    pub steps: usize,
    /// Points per step.
    pub batch: usize,
}

impl HashSettings {
    /// Settings for a volume of that many cells.
    pub fn for_cells(cells: [usize; 3]) -> Self {
        Self { cells, n_levels: 8, log2_hashmap_size: 19, width: 64, steps: 2500, batch: 1 << 14 }
    }

    fn config(&self, k: usize) -> HashFieldConfig<3> {
        let finest = self.cells.map(|c| c as u32);
        let base = [finest[0].min(16), finest[1].min(16), finest[2].min(2)];
        let mut config = HashFieldConfig::small(k);
        config.encoding = HashGridConfig {
            n_levels: self.n_levels,
            n_features_per_level: 2,
            log2_hashmap_size: self.log2_hashmap_size,
            base_resolution: base,
            finest_resolution: finest,
        };
        config.width = self.width;
        config.training.schedule.n_steps = self.steps as u64;
        config.training.schedule.final_factor = 0.01;
        config
    }
}

/// What identifies the form in a checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HashShape {
    /// Settings.
    pub settings: HashSettings,
    /// Pattern channels.
    pub k: usize,
    /// Encoding and network.
    pub config: HashFieldConfig<3>,
    /// Number of parameters.
    pub n_params: usize,
}

impl HashShape {
    /// Number of parameters.
    pub fn n_params(&self) -> usize {
        self.n_params
    }
}

/// A color field as hash encoding and network.
#[derive(Clone, Debug)]
pub struct HashForm {
    shape: HashShape,
    field: HashField<3>,
}

impl HashForm {
    /// An untrained form.
    pub fn new(settings: HashSettings, k: usize, seed: u64) -> Self {
        let config = settings.config(k);
        let field = HashField::new(config.clone(), seed).expect("settings make a valid configuration");
        let shape = HashShape { settings, k, config, n_params: field.params().len() };
        Self { shape, field }
    }

    /// A form from a checkpoint; `None` when shape and parameters do not fit each other.
    pub fn from_params(shape: HashShape, params: Vec<f32>) -> Option<Self> {
        let field = HashField::from_params(shape.config.clone(), params).ok()?;
        (field.n_outputs() == shape.k).then_some(Self { shape, field })
    }

    /// Pattern channels.
    pub fn k(&self) -> usize {
        self.shape.k
    }

    /// What identifies it.
    pub fn shape(&self) -> &HashShape {
        &self.shape
    }

    /// All parameters.
    pub fn params(&self) -> &[f32] {
        self.field.params()
    }

    /// Trains on the samples that the bins stand for, each drawn with equal probability and weighed by its precision
    /// relative to the others. A second call starts the learning-rate schedule anew from the present parameters.
    pub fn train(&mut self, bins: &Bins, seed: u64, progress: &Progress) {
        let k = self.shape.k;
        let (mut points, mut targets, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        bins.for_each_sample(|q, values, omegas| {
            // A missing channel has no value to learn; few samples lack one.
            if omegas.iter().all(|w| *w > 0.0) {
                points.push(q);
                targets.extend_from_slice(values);
                weights.push(omegas.iter().sum::<f32>() / k as f32);
            }
        });
        if points.is_empty() {
            return;
        }
        // Precisions span decades; beyond the median one the field's own error dominates the sensor's.
        let mut sorted = weights.clone();
        let mid = sorted.len() / 2;
        let median = *sorted.select_nth_unstable_by(mid, f32::total_cmp).1;
        weights.iter_mut().for_each(|w| *w = (*w / median).min(2.0));
        let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
        let s = self.shape.settings.clone();
        let (mut p, mut t, mut w) =
            (Vec::with_capacity(s.batch), Vec::with_capacity(s.batch * k), Vec::with_capacity(s.batch));
        for step in 0..s.steps {
            if progress.cancelled() {
                break;
            }
            progress.tick(step, s.steps);
            (p.clear(), t.clear(), w.clear());
            for _ in 0..s.batch {
                let i = rng.random_range(0..points.len());
                p.push(points[i]);
                t.extend_from_slice(&targets[i * k..(i + 1) * k]);
                w.push(weights[i]);
            }
            self.field.train_step(&p, &t, &w);
        }
        self.field.finish_training();
    }

    /// The spline through the form's values at the nodes of its finest level.
    pub fn to_grid(&self) -> Grid {
        let cells = self.shape.settings.cells;
        let mut grid = Grid::new(cells, self.shape.k);
        let [na, nb, nw] = grid.nodes();
        let k = self.shape.k;
        let at = |i: usize, n: usize| ((i as f32 - 1.0) / n as f32).clamp(0.0, 1.0);
        let points: Vec<[f32; 3]> = (0..nb * na * nw)
            .map(|i| [at(i / nw % na, cells[0]), at(i / nw / na, cells[1]), at(i % nw, cells[2])])
            .collect();
        let mut values = vec![0.0; points.len() * k];
        self.field.query(&points, &mut values);
        grid.interpolate(&values);
        grid
    }
}
