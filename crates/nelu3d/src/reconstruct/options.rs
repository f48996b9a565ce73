//! Options of a reconstruction.

use nelu3d_field::device::Choice;
use serde::{Deserialize, Serialize};

use super::effort::Effort;
use super::neural::PaperOptions;

/// The recipe by which a surface is reconstructed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Recipe {
    /// Cost volume, then narrow-band volume rendering
    #[default]
    Fast,
    /// As published: a hash-encoded signed distance field trained from scratch, 10,000 iterations
    Paper,
}

/// Ways to handle camera channels that respond to each other's light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum CrosstalkMode {
    /// Corrected in color images; the matrix comes from the color field or, without one there, from the scene
    #[default]
    Auto,
    /// Not corrected
    Off,
}

/// Settings of a reconstruction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct ReconstructionOptions {
    /// How the surface is found
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Self::default().recipe))]
    pub recipe: Recipe,
    /// Seed of everything random
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Self::default().seed))]
    pub seed: u64,
    /// How much work to put in
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Self::default().effort))]
    pub effort: Effort,
    /// Steps of the narrow-band refinement (default: by effort), or iterations of recipe `paper` (default: 10000)
    #[cfg_attr(feature = "clap", arg(long, value_name = "N"))]
    pub steps: Option<usize>,
    /// Maximum number of depth hypotheses of the cost volume
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Self::default().max_labels))]
    pub max_labels: usize,
    /// Roughness that any surface is allowed: typical second difference between neighboring pixels, in px of disparity;
    /// where it proves smoother, that counts
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Self::default().roughness))]
    pub roughness: f32,
    /// Smallest connected component of the surface that is valid, px
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Self::default().min_component))]
    pub min_component: usize,
    /// What to do about camera channels that respond to each other's light (recipe `fast`, color cameras)
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Self::default().cross_talk))]
    pub cross_talk: CrosstalkMode,
    /// Where the heavy work is done: auto (a GPU, if there is one), cpu, gpu, or gpu:N as in `nelu3d devices`
    #[serde(skip)]
    #[cfg_attr(feature = "clap", arg(long, default_value_t = Self::default().device))]
    pub device: Choice,
    /// Settings of recipe `paper`.
    #[cfg_attr(feature = "clap", command(flatten))]
    pub paper: PaperOptions,
}

impl Default for ReconstructionOptions {
    fn default() -> Self {
        Self {
            recipe: Recipe::Fast,
            seed: 0,
            effort: Effort::Normal,
            steps: None,
            max_labels: 512,
            roughness: 0.14,
            min_component: 40,
            cross_talk: CrosstalkMode::Auto,
            device: Choice::Auto,
            paper: PaperOptions::default(),
        }
    }
}
