//! What a caller chooses about TurboSL.

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
    /// Samples per iteration; the number of rays follows
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 262_144))]
    pub samples: usize,
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
}

#[cfg(feature = "clap")]
fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if v > 0.0 && f64::is_finite(v) => Ok(v),
        _ => Err("a positive number".into()),
    }
}

impl Default for TurboSlOptions {
    fn default() -> Self {
        Self { steps: 10_000, samples: 262_144, start: Start::default(), seed: 0, no_reverse: false, unit_mm: None }
    }
}
