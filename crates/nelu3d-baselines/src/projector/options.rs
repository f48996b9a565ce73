//! What a caller chooses about a projector calibration.

use serde::{Deserialize, Serialize};

/// Which lens distortion of the projector is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Lens {
    /// None.
    None,
    /// k1, k2.
    Radial,
    /// k1, k2, p1, p2.
    Full,
}

/// Settings of a projector calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct ProjectorOptions {
    /// Which lens distortion is fitted
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Lens::Full))]
    pub lens: Lens,
    /// Half the side of the square around a corner that its homography is fitted to, camera px (default: a fortieth of
    /// the image's longer side, at least 8)
    #[cfg_attr(feature = "clap", arg(long, value_name = "PX"))]
    pub radius: Option<usize>,
    /// Least white − black of a pixel, as a share of full scale
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0.02))]
    pub min_contrast: f32,
}

impl Default for ProjectorOptions {
    fn default() -> Self {
        Self { lens: Lens::Full, radius: None, min_contrast: 0.02 }
    }
}
