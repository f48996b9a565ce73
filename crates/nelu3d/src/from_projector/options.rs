//! Options of a color field from a calibrated projector.

use serde::{Deserialize, Serialize};

/// Settings of a color field from a calibrated projector.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct FromProjectorOptions {
    /// Depth range of the field in mm, for --from-projector (default: around the sweep's boards, or around where the
    /// scenes without a sweep are explained)
    #[cfg_attr(feature = "clap", arg(long, num_args = 2, value_names = ["NEAR", "FAR"]))]
    pub depth: Option<Vec<f64>>,
}
