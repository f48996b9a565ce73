//! What a caller chooses about LookUp3D.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// Settings of LookUp3D.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[cfg_attr(feature = "clap", command(next_help_heading = "LookUp3D"))]
#[serde(default, deny_unknown_fields)]
pub struct LookupOptions {
    /// Lookup table to decode with, .npy or .npz (default: built from the rig's sweep)
    #[cfg_attr(feature = "clap", arg(long, value_name = "FILE"))]
    #[serde(serialize_with = "nelu3d_scan::path_text::serialize_option")]
    pub table: Option<PathBuf>,
    /// Build the table for every Nth pixel and row only; pixels between them are interpolated [default: 1]
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", conflicts_with = "table"))]
    pub stride: Option<usize>,
    /// Terms per channel of a low-rank table that is made here (default: as few as lose no more than its own noise)
    #[cfg_attr(feature = "clap", arg(long, value_name = "R"))]
    pub rank: Option<usize>,
    /// Result folder of the frame before: look around its depth first
    #[cfg_attr(feature = "clap", arg(long, value_name = "RESULT"))]
    #[serde(serialize_with = "nelu3d_scan::path_text::serialize_option")]
    pub previous: Option<PathBuf>,
    /// How the table is searched.
    #[cfg_attr(feature = "clap", command(flatten))]
    pub settings: SearchSettings,
}

/// Which positions are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Search {
    /// All of them.
    Brute,
    /// All for a part of the pixels, for the others those around what these found; all where that explains nothing.
    CoarseToFine,
}

/// How the depth between positions is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// Not at all: the depth of the nearest position, as in the LookUp3D tools.
    None,
    /// Lowest point of the parabola through the squared distances at the nearest position and its neighbors.
    Parabola,
    /// Closest point of the polyline through the codewords, over inverse depth.
    Linear,
    /// Closest point of the cubic through the four codewords around a segment, over inverse depth.
    Cubic,
}

impl Interpolation {
    /// Returns the error of the interpolation itself, in normalized intensity: on `dlp` the held-out positions are met
    /// to 0.022 linearly and to 0.008 cubically. Without interpolation, the steps between codewords stand for it.
    pub(crate) fn error(self) -> f32 {
        match self {
            Interpolation::None | Interpolation::Parabola => 0.005,
            Interpolation::Linear => 0.02,
            Interpolation::Cubic => 0.01,
        }
    }
}

/// How a lookup table is searched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct SearchSettings {
    /// Which positions of the lookup table are compared
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Search::Brute))]
    pub search: Search,
    /// How the depth between positions of the lookup table is found
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Interpolation::Cubic))]
    pub interpolation: Interpolation,
    /// Residual above which a pixel is rejected, in standard deviations of the noise (0: reject none, as published)
    #[cfg_attr(feature = "clap", arg(long, value_name = "SIGMAS", default_value_t = 0.0))]
    pub max_residual: f32,
    /// RMS difference to the table's codeword above which a pixel is rejected, in normalized intensity (0: reject none)
    #[cfg_attr(feature = "clap", arg(long, value_name = "RMS", default_value_t = 0.0))]
    pub max_difference: f32,
    /// Coarse to fine: every Nth pixel and row is decoded first
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 4))]
    pub coarse: usize,
    /// Coarse to fine, and with an earlier result: positions on either side of the expected ones
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 2))]
    pub window: usize,
}

impl Default for SearchSettings {
    fn default() -> Self {
        Self {
            search: Search::Brute,
            interpolation: Interpolation::Cubic,
            max_residual: 0.0,
            max_difference: 0.0,
            coarse: 4,
            window: 2,
        }
    }
}
