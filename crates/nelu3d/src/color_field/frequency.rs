//! Form `frequency`: sines and cosines of the coordinates in octaves, and a network, over the unit cube of a
//! [`FieldFrame`](super::frame::FieldFrame) (paper, Fig. 3; the encoding is Eq. 4 of NeRF).
//!
//! The paper's 20 octaves reach 2^18 periods across the volume, far beyond what samples a pixel apart, and a few planes
//! along the light's rays, can supervise: those octaves are noise to the network, and along w they put wiggles between
//! the board positions. So by default an axis has only the octaves that its cells resolve. [`Octaves::Paper`] keeps all
//! 20.
//!
//! The paper gives no size for the network, and NeRF's 8 × 256 would train for an hour here. Ours is 4 × 64: with it
//! the paper's 5,000 steps reach the quality of the other forms on `dlp` (docs/color-field-forms.md).

use nelu3d_field::{FrequencyField, FrequencyFieldConfig};
use serde::{Deserialize, Serialize};

use super::bins::Bins;
use super::grid::Grid;
use super::network::{NetworkForm, NetworkShape, TrainingSamples};
use crate::progress::Progress;

/// Length of a second training relative to the first.
const AGAIN: f64 = 0.3;
/// Learning rate of a second training relative to the first.
const AGAIN_RATE: f64 = 0.3;

/// The octaves that coordinates are encoded in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Octaves {
    /// As many octaves per axis as the sweep supervises
    Supervised,
    /// 20 octaves on every axis, as in the paper
    Paper,
}

/// Settings of a [`FrequencyForm`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrequencySettings {
    /// Cells of the volume along a, b and w.
    pub cells: [usize; 3],
    /// Octaves of the encoding.
    pub octaves: Octaves,
    /// Number of steps of a training.
    pub steps: usize,
    /// Number of points per step.
    pub batch: usize,
}

impl FrequencySettings {
    /// Returns the settings of a volume of that many cells: 5,000 steps, as in the paper.
    pub fn for_cells(cells: [usize; 3], octaves: Octaves) -> Self {
        Self { cells, octaves, steps: 5000, batch: 2048 }
    }

    /// Returns the sizes of the network for `k` channels.
    pub fn config(&self, k: usize) -> FrequencyFieldConfig {
        let mut config = FrequencyFieldConfig::paper(k);
        if self.octaves == Octaves::Supervised {
            // The finest octave of n has 2^(n − 2) periods: at least four cells each.
            config.n_frequencies = self.cells.map(|c| c.max(1).ilog2() as usize);
        }
        config.width = 64;
        config.learning_rate = 3e-3;
        config.schedule.final_factor = 0.01;
        config
    }
}

/// The description of a [`FrequencyForm`] in a checkpoint.
pub type FrequencyShape = NetworkShape<FrequencySettings, FrequencyFieldConfig>;

/// A color field as frequency encoding and network.
pub type FrequencyForm = NetworkForm<FrequencySettings, FrequencyField>;

impl FrequencyForm {
    /// Initializes a form.
    pub fn new(settings: FrequencySettings, k: usize, seed: u64) -> Self {
        let config = settings.config(k);
        Self::untrained(settings, config, k, seed)
    }

    /// Trains on the samples that the bins stand for, in random order, each weighed by its precision relative to the
    /// others. A form that was trained before goes on from its parameters, with a shorter schedule and a lower rate.
    pub fn train(&mut self, bins: &Bins, seed: u64, progress: &Progress) {
        let Some(mut samples) = TrainingSamples::new(bins, 1, seed) else { return };
        let (length, rate) = if self.is_trained() { (AGAIN, AGAIN_RATE) } else { (1.0, 1.0) };
        let FrequencySettings { steps, batch, .. } = self.shape().settings;
        let steps = (steps as f64 * length).ceil() as usize;
        let mut config = self.shape().config.clone();
        config.schedule.n_steps = steps as u64;
        config.learning_rate *= rate;
        self.begin_training(config);
        self.train_on_cpu(&mut samples, batch, steps, progress);
        self.finish_training();
    }

    /// Returns the spline through the form's values at the corners of the volume's cells.
    pub fn to_grid(&self) -> Grid {
        self.spline(self.shape().settings.cells)
    }
}
