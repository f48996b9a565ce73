//! Settings of recipe `paper`.

use serde::{Deserialize, Serialize};

use super::ambient::Ambient;
use super::checkpoint::CheckpointOptions;
use super::config::{self, PUBLISHED_SAMPLES};
use super::start::Start;

/// The first shape of the signed distance field of recipe `paper`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum PaperStart {
    /// None, as TurboSL's public code has it: random parameters
    Random,
    /// A plane through the middle of the volume that faces the camera
    Plane,
    /// A sphere of half a unit in the middle of the volume
    Sphere,
    /// The surface that recipe `fast` decodes from its cost volume, before it refines it
    #[default]
    Lookup,
}

impl PaperStart {
    /// Returns how far the cosine of the alphas is annealed at a step, 0 to 1. The published schedule takes slopes for
    /// steeper than they are while the surface has none; a decoded one has its slopes from the start.
    pub(super) fn anneal(self, step: usize, n_steps: usize) -> f32 {
        if self == Self::Lookup { 1.0 } else { config::anneal(step, n_steps) }
    }

    /// Returns the number of steps over which a GPU anneals it as [`Self::anneal`] says; 0 where it is 1 from the start.
    #[cfg(feature = "gpu")]
    pub(super) fn anneal_steps(self, n_steps: usize) -> usize {
        if self == Self::Lookup { 0 } else { config::anneal_steps(n_steps) }
    }

    /// Returns the shape that needs no scene; `None` for the decoded surface.
    pub(super) fn shape(self) -> Option<Start> {
        match self {
            Self::Random => Some(Start::Random),
            Self::Plane => Some(Start::Plane),
            Self::Sphere => Some(Start::Sphere),
            Self::Lookup => None,
        }
    }
}

/// Rays whose pixel is too dark to show an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// They are not drawn: all rays go to pixels with a codeword
    Crop,
    /// They are drawn and should be black and transparent, as published; the mask loss has no gradient where the start
    /// blocks them for certain
    #[default]
    Clamped,
    /// They are drawn, with a mask loss that does not saturate; it can push a plane behind the object
    Carve,
}

/// Settings of recipe `paper`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[cfg_attr(feature = "clap", command(next_help_heading = "Recipe `paper` and TurboSL"))]
#[serde(default, deny_unknown_fields)]
pub struct PaperOptions {
    /// First shape of the signed distance field
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Self::default().start))]
    pub start: PaperStart,
    /// α of Eq. 4: 1 for the lookup loss alone, 0 for the pattern loss alone
    #[cfg_attr(feature = "clap", arg(long, value_name = "A", value_parser = unit_interval))]
    #[cfg_attr(feature = "clap", arg(default_value_t = Self::default().lookup_loss_weight))]
    pub lookup_loss_weight: f64,
    /// The ambient term
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Self::default().ambient))]
    pub ambient: Ambient,
    /// What becomes of rays that miss the object
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Self::default().background))]
    pub background: Background,
    /// Samples per iteration; the number of rays follows
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = Self::default().samples))]
    pub samples: usize,
    /// Largest number of samples of a ray where `--samples` is below the published 262144: half of them spread evenly,
    /// half where these see the surface; 0 marches as published
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = Self::default().ray_samples))]
    pub ray_samples: usize,
    /// v of the sharpness exp(10 v) that the surface begins with, per unit (default: 0.3 as published; as sharp as a
    /// pixel is wide with `--start lookup`, whose surface is known better)
    #[cfg_attr(feature = "clap", arg(long, value_name = "V"))]
    pub sharpness: Option<f64>,
    /// Length of the unit in which distances and losses are measured; the field is a cube of 3 units around the middle
    /// of the calibrated volume (default: a third of that volume's longest side)
    #[cfg_attr(feature = "clap", arg(long, value_name = "MM", value_parser = positive))]
    pub unit_mm: Option<f64>,
    /// Whether and where the state of the training is kept.
    #[serde(skip)]
    #[cfg_attr(feature = "clap", command(flatten))]
    pub checkpoint: CheckpointOptions,
}

/// Reads a positive number from the command line.
#[cfg(feature = "clap")]
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if v > 0.0 && f64::is_finite(v) => Ok(v),
        _ => Err("a positive number".into()),
    }
}

#[cfg(feature = "clap")]
fn unit_interval(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if (0.0..=1.0).contains(&v) => Ok(v),
        _ => Err("a number from 0 to 1".into()),
    }
}

impl Default for PaperOptions {
    fn default() -> Self {
        Self {
            start: PaperStart::default(),
            lookup_loss_weight: 0.1,
            ambient: Ambient::Bounded,
            background: Background::default(),
            samples: PUBLISHED_SAMPLES,
            ray_samples: 64,
            sharpness: None,
            unit_mm: None,
            checkpoint: CheckpointOptions::default(),
        }
    }
}
