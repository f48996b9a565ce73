//! Form `hash`: a multiresolution hash encoding and a small network over the unit cube of a
//! [`FieldFrame`](super::frame::FieldFrame).
//!
//! The published form uses isotropic levels up to 2048 cells in camera coordinates; levels finer than the sweep's step
//! are never supervised between board positions and put wiggles there. Here the levels are anisotropic and live in the
//! field's frame: fine across, and along w no finer than what the sweep supervises.

use nelu3d_field::device::Device;
use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::{HashField, HashFieldConfig};
use serde::{Deserialize, Serialize};

use super::bins::Bins;
use super::grid::Grid;
#[cfg(feature = "gpu")]
use super::network::SampleBatch;
use super::network::{NetworkForm, NetworkShape, TrainingSamples};
use crate::progress::Progress;

/// Number of neighboring samples that are drawn together, because they share cache lines of the table. More than two
/// are too alike for a batch to count as its size (groups of 8 cost 1 dB at the same number of samples on `dlp`).
const GROUP: usize = 2;
/// Length of a second training relative to the first: the parameters have to take up only what is new.
const AGAIN: f64 = 0.4;
/// Learning rates of a second training relative to the first.
const AGAIN_RATE: f64 = 0.3;
/// Fewest steps of a training: small volumes have few samples, and the network needs some time whatever they are.
const MIN_STEPS: usize = 1000;

/// Settings of a [`HashForm`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HashSettings {
    /// Cells of the volume along a, b and w.
    pub cells: [usize; 3],
    /// Cells of the volume per cell of the finest level, across: levels as fine as the samples learn their noise.
    pub coarsening: usize,
    /// Number of levels.
    pub n_levels: usize,
    /// log2 of the table's entries per level.
    pub log2_hashmap_size: u32,
    /// Number of units of a hidden layer.
    pub width: usize,
    /// Number of times that a training goes through the samples; it takes a thousand steps at least.
    pub epochs: f64,
    /// Number of points per step.
    pub batch: usize,
}

impl HashSettings {
    /// Returns the settings of a volume of that many cells.
    pub fn for_cells(cells: [usize; 3]) -> Self {
        Self { cells, coarsening: 2, n_levels: 8, log2_hashmap_size: 18, width: 32, epochs: 4.0, batch: 1 << 11 }
    }

    /// Returns the cells of the finest level along a, b and w.
    pub(super) fn finest(&self) -> [u32; 3] {
        let across = |cells: usize| cells.div_ceil(self.coarsening.max(1)) as u32;
        [across(self.cells[0]), across(self.cells[1]), self.cells[2] as u32]
    }

    fn config(&self, k: usize) -> HashFieldConfig<3> {
        let finest = self.finest();
        let mut config = HashFieldConfig::small(k);
        config.encoding = HashGridConfig {
            n_levels: self.n_levels,
            n_features_per_level: 2,
            log2_hashmap_size: self.log2_hashmap_size,
            base_resolution: [finest[0].min(16), finest[1].min(16), finest[2].min(2)],
            finest_resolution: finest,
        };
        config.width = self.width;
        config.training.encoding_learning_rate = 5e-3;
        config.training.schedule.final_factor = 0.01;
        config
    }
}

/// The description of a [`HashForm`] in a checkpoint.
pub type HashShape = NetworkShape<HashSettings, HashFieldConfig<3>>;

/// A color field as hash encoding and network.
pub type HashForm = NetworkForm<HashSettings, HashField<3>>;

impl HashForm {
    /// Initializes a form.
    pub fn new(settings: HashSettings, k: usize, seed: u64) -> Self {
        let config = settings.config(k);
        Self::untrained(settings, config, k, seed)
    }

    /// Trains on the samples that the bins stand for, in random order, each weighed by its precision relative to the
    /// others. A form that was trained before goes on from its parameters, with a shorter schedule and lower rates.
    ///
    /// If the device fails, training begins again on the CPU.
    pub fn train(&mut self, bins: &Bins, seed: u64, device: &Device, progress: &Progress) {
        let Some(mut samples) = TrainingSamples::new(bins, GROUP, seed) else { return };
        let s = &self.shape().settings;
        let n = samples.len();
        let batch = s.batch.clamp(GROUP, n.max(GROUP));
        let (length, rate) = if self.is_trained() { (AGAIN, AGAIN_RATE) } else { (1.0, 1.0) };
        let steps = (s.epochs * n as f64 / batch as f64).max(MIN_STEPS as f64) * length;
        let steps = steps.ceil() as usize;
        let mut config = self.shape().config.clone();
        config.training.schedule.n_steps = steps as u64;
        config.training.encoding_learning_rate *= rate;
        config.training.network_learning_rate *= rate;
        self.begin_training(config);
        match device {
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => {
                // Every sample once in random order, and that order again and again.
                let mut all = SampleBatch::default();
                samples.draw(n, &mut all);
                let SampleBatch { points, targets, weights } = &all;
                let all = nelu3d_field::gpu::Samples { points, targets, weights };
                let go_on = |step: usize| {
                    progress.tick(step, steps);
                    !progress.cancelled()
                };
                if let Err(e) = self.network_mut().train_on(gpu, &all, batch, steps, go_on) {
                    progress.warn(format!("{e}; the field is trained on the CPU instead"));
                    return self.train(bins, seed, &Device::Cpu, progress);
                }
            }
            Device::Cpu => self.train_on_cpu(&mut samples, batch, steps, progress),
        }
        self.finish_training();
    }

    /// Returns the spline through the form's values at the corners of the volume's cells.
    pub fn to_grid(&self) -> Grid {
        self.spline(self.shape().settings.cells)
    }
}
