//! What a caller chooses about TurboSL.

use nelu3d::reconstruct::neural::CheckpointOptions;
#[cfg(feature = "clap")]
use nelu3d::reconstruct::neural::positive;
use nelu3d::reconstruct::neural::start::Start;
use serde::{Deserialize, Serialize};

/// Settings of TurboSL.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[cfg_attr(feature = "clap", command(next_help_heading = "TurboSL"))]
#[serde(default, deny_unknown_fields)]
pub struct TurboSlOptions {
    /// Iterations
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 10_000))]
    pub steps: usize,
    /// Stop after this many iterations; rates and losses follow the schedule of all `--steps`
    #[cfg_attr(feature = "clap", arg(long, value_name = "N"))]
    pub stop_after: Option<usize>,
    /// Samples per iteration; the number of rays follows
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 262_144))]
    pub samples: usize,
    /// Largest number of samples of a ray where `--samples` is below the published 262144: half of them spread evenly,
    /// half where these see the surface; 0 marches as published
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 64))]
    pub ray_samples: usize,
    /// First shape of the signed distance field
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Start::default()))]
    pub start: Start,
    /// Seed of everything random
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0))]
    pub seed: u64,
    /// Render from the camera only, never the patterns from the captures
    #[cfg_attr(feature = "clap", arg(long))]
    pub no_reverse: bool,
    /// Length of the unit in which distances and losses are measured; the field is a cube of 3 units around the middle
    /// of the volume (default: a third of that volume's longest side)
    #[cfg_attr(feature = "clap", arg(long, value_name = "MM", value_parser = positive))]
    pub unit_mm: Option<f64>,
    /// Whether and where the state of the training is kept; with `stop_after` it stays when that is reached.
    #[serde(skip)]
    #[cfg_attr(feature = "clap", command(flatten))]
    pub checkpoint: CheckpointOptions,
}

impl Default for TurboSlOptions {
    fn default() -> Self {
        Self {
            steps: 10_000,
            stop_after: None,
            samples: 262_144,
            ray_samples: 64,
            start: Start::default(),
            seed: 0,
            no_reverse: false,
            unit_mm: None,
            checkpoint: CheckpointOptions::default(),
        }
    }
}
