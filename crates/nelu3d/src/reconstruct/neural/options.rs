//! Settings of recipe `paper`.

use serde::{Deserialize, Serialize};

use super::ambient::Ambient;
use super::start::Start;

/// Rays whose pixel is too dark to show an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// They are not drawn: all rays go to pixels with a codeword
    #[default]
    Crop,
    /// They are drawn, with the published mask loss, which has no gradient where the start blocks them for certain
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
    pub start: Start,
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
            start: Start::Plane,
            lookup_loss_weight: 0.1,
            ambient: Ambient::Bounded,
            background: Background::Crop,
            samples: 262_144,
        }
    }
}
