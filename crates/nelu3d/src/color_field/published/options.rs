//! Options of form `published`.

use nelu3d_field::HashFieldConfig;
use nelu3d_field::adam::Schedule;
use nelu3d_field::encoding::hash_grid::{HashGrid, HashGridConfig};
use nelu3d_field::field::{FieldError, TrainConfig};
use nelu3d_field::mlp::{Activation, MlpConfig};
use serde::{Deserialize, Serialize};

/// One part of the iterations in this many warms up.
const WARMUP: u64 = 20;

/// Encoding, network and training of form `published`. The defaults are the paper's where it states them (16 levels of
/// 2 features, 2^19 entries, 5,000 iterations, 49 MB) and its references' where it does not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[cfg_attr(feature = "clap", command(next_help_heading = "Form `published`"))]
#[serde(default, deny_unknown_fields)]
pub struct PublishedOptions {
    /// Levels of the hash grid
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", value_parser = within(1, 32)))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().levels))]
    pub levels: usize,
    /// Features of an entry: 1, 2, 4, or 8
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", value_parser = power_of_two))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().features))]
    pub features: usize,
    /// log2 of the entries of a level
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", value_parser = within(4, 24)))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().log2_entries))]
    pub log2_entries: usize,
    /// Cells of the coarsest level along each axis of the cube around the volume
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", value_parser = within(1, 65536)))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().base_cells))]
    pub base_cells: usize,
    /// Cells of the finest level along each axis; at least the coarsest's
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", value_parser = within(1, 65536)))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().finest_cells))]
    pub finest_cells: usize,
    /// Units of a hidden layer
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", value_parser = within(1, 256)))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().units))]
    pub units: usize,
    /// Hidden layers
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", value_parser = within(1, 8)))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().hidden_layers))]
    pub hidden_layers: usize,
    /// Iterations of its training
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", value_parser = within(1, 10_000_000)))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().iterations))]
    pub iterations: usize,
    /// Samples of an iteration, drawn from all positions
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", value_parser = within(1, 1 << 24)))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().batch))]
    pub batch: usize,
    /// Learning rate of Adam, after a warm-up over a twentieth of the iterations; it ends at a tenth
    #[cfg_attr(feature = "clap", arg(long, value_name = "RATE", value_parser = positive))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().rate))]
    pub rate: f64,
}

/// Makes a reader of whole numbers of a range from the command line.
#[cfg(feature = "clap")]
fn within(low: usize, high: usize) -> impl Fn(&str) -> Result<usize, String> + Clone + Send + Sync + 'static {
    move |text: &str| match text.parse() {
        Ok(n) if (low..=high).contains(&n) => Ok(n),
        _ => Err(format!("a whole number from {low} to {high}")),
    }
}

/// Reads a number of features from the command line.
#[cfg(feature = "clap")]
fn power_of_two(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n @ (1 | 2 | 4 | 8)) => Ok(n),
        _ => Err("1, 2, 4, or 8".into()),
    }
}

/// Reads a positive number from the command line.
#[cfg(feature = "clap")]
fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if v > 0.0 && f64::is_finite(v) => Ok(v),
        _ => Err("a positive number".into()),
    }
}

impl PublishedOptions {
    /// Returns encoding, network and training for `k` outputs.
    pub(in crate::color_field) fn config(&self, k: usize) -> HashFieldConfig<3> {
        let n_steps = self.iterations as u64;
        let small = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let schedule =
            Schedule { n_warmup_steps: (n_steps / WARMUP).max(1), warmup_start: 0.01, n_steps, final_factor: 0.1 };
        HashFieldConfig {
            encoding: HashGridConfig {
                n_levels: self.levels,
                n_features_per_level: self.features,
                log2_hashmap_size: small(self.log2_entries),
                base_resolution: [small(self.base_cells); 3],
                finest_resolution: [small(self.finest_cells); 3],
            },
            n_outputs: k,
            width: self.units,
            n_hidden_layers: self.hidden_layers,
            output_activation: Activation::Linear,
            append_position: true,
            training: TrainConfig {
                encoding_learning_rate: self.rate,
                network_learning_rate: self.rate,
                schedule,
                weight_normalization: true,
                ..TrainConfig::default()
            },
        }
    }

    /// Checks that the sizes make a field of `k` outputs.
    ///
    /// # Errors
    ///
    /// The first size that is out of range, or a finest level that is coarser than the coarsest.
    pub fn check(&self, k: usize) -> Result<(), FieldError> {
        let config = self.config(k);
        let grid = HashGrid::new(&config.encoding)?;
        let mlp = MlpConfig {
            n_inputs: grid.n_features() + 3,
            n_outputs: k,
            width: config.width,
            n_hidden_layers: config.n_hidden_layers,
            output_activation: config.output_activation,
        };
        Ok(mlp.validate()?)
    }
}

impl Default for PublishedOptions {
    fn default() -> Self {
        Self {
            levels: 16,
            features: 2,
            log2_entries: 19,
            base_cells: 16,
            finest_cells: 2048,
            units: 64,
            hidden_layers: 2,
            iterations: 5000,
            batch: 1 << 14,
            rate: 1e-2,
        }
    }
}
