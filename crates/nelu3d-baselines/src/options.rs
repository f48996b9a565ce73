//! What a caller chooses about a decoding.

use serde::{Deserialize, Serialize};

use super::error::DecodeError;
use super::method::Method;
use super::{lookup3d, turbosl};

/// Which columns a codeword is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Columns {
    /// Those along the pixel's epipolar line, within the depth range.
    Epipolar,
    /// All.
    All,
}

/// Settings of a decoding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(deny_unknown_fields)]
pub struct DecodeOptions {
    /// How the patterns are decoded
    #[cfg_attr(feature = "clap", arg(long, value_enum))]
    pub method: Method,
    /// Depth range in mm (default: that of RIG/fields/SET.safetensors if there is one, so that all methods have the
    /// same volume, else any depth for codes that need no range, and around where light and view cross for the others)
    #[cfg_attr(feature = "clap", arg(long, num_args = 2, value_names = ["NEAR", "FAR"]))]
    pub depth: Option<Vec<f64>>,
    /// Which columns a codeword is compared with (mps, zncc)
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Columns::Epipolar))]
    pub columns: Columns,
    /// Side of the window over which correlations are summed, px, odd (zncc; default: 1 with six images or more and
    /// with
    /// --columns all, else 9)
    #[cfg_attr(feature = "clap", arg(long, value_name = "PX"))]
    pub patch: Option<usize>,
    /// Least correlation, -1 to 1 (zncc)
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0.9))]
    pub min_score: f32,
    /// Blur of the projected images on the scene, standard deviation in projector px (zncc; default: estimated)
    #[cfg_attr(feature = "clap", arg(long, value_name = "PX"))]
    pub blur: Option<f32>,
    /// Light that the projector makes of a value v of the projected images: v to this power (default: the response that
    /// `nelu3d projector` measured, if projector.json has one, else 1)
    #[cfg_attr(feature = "clap", arg(long, value_name = "POWER"))]
    pub gamma: Option<f64>,
    /// Least white − black of a pixel, as a share of full scale
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0.02))]
    pub min_contrast: f32,
    /// Smallest connected piece of surface that is not rejected, px
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 40))]
    pub min_component: usize,
    /// Settings of LookUp3D.
    #[cfg_attr(feature = "clap", command(flatten))]
    #[serde(default)]
    pub lookup3d: lookup3d::LookupOptions,
    /// Settings of TurboSL.
    #[cfg_attr(feature = "clap", command(flatten))]
    #[serde(default)]
    pub turbosl: turbosl::TurboSlOptions,
}

impl DecodeOptions {
    /// The default settings of a method.
    pub fn new(method: Method) -> Self {
        Self {
            method,
            depth: None,
            columns: Columns::Epipolar,
            patch: None,
            min_score: 0.9,
            blur: None,
            gamma: None,
            min_contrast: 0.02,
            min_component: 40,
            lookup3d: Default::default(),
            turbosl: Default::default(),
        }
    }
}

impl DecodeOptions {
    /// Rejects settings that make no sense.
    pub(crate) fn check(&self) -> Result<(), DecodeError> {
        let opts = self;
        if let Some(gamma) = opts.gamma.filter(|g| !(*g > 0.0 && g.is_finite())) {
            return Err(DecodeError::Setting {
                setting: "gamma",
                problem: format!("is {gamma}: give a positive number"),
            });
        }
        if !(0.0..1.0).contains(&opts.min_contrast) {
            let problem = format!("is {}: give a number from 0 to below 1", opts.min_contrast);
            return Err(DecodeError::Setting { setting: "min_contrast", problem });
        }
        let longest = if opts.columns == Columns::All { 1 } else { 63 };
        if let Some(patch) = opts.patch.filter(|w| w.is_multiple_of(2) || *w > longest) {
            let problem =
                format!("is {patch}: give an odd number of pixels up to 63, and 1 with setting `columns` all");
            return Err(DecodeError::Setting { setting: "patch", problem });
        }
        if !(-1.0..=1.0).contains(&opts.min_score) {
            return Err(DecodeError::Setting {
                setting: "min_score",
                problem: format!("is {}: give -1 to 1", opts.min_score),
            });
        }
        if opts.blur.is_some_and(|b| !(0.0..=100.0).contains(&b)) {
            return Err(DecodeError::Setting {
                setting: "blur",
                problem: "is no number of pixels from 0 to 100".into(),
            });
        }
        Ok(())
    }
}
