//! What a reconstruction puts on record, typed: `result/` makes JSON of it.

use serde::Serialize;

use super::effort::EffortSettings;
use super::neural::TrainingRecord;
use super::options::ReconstructionOptions;
use super::settings::FastSettings;
use crate::color_field::ColorField;
use crate::sensor::CrosstalkMatrix;

/// What a reconstruction puts on record besides the surface and the times.
#[derive(Clone, Debug, Serialize)]
pub struct Diagnostics {
    /// The settings it was asked for.
    pub settings: ReconstructionOptions,
    /// Where the heavy work was done.
    pub device: String,
    /// The color field that was used.
    pub field: FieldOrigin,
    /// What only one recipe knows.
    #[serde(flatten)]
    pub recipe: RecipeDiagnostics,
}

impl Diagnostics {
    /// The crosstalk that was corrected; `None` where none can be (gray cameras, recipe `paper`).
    pub fn crosstalk(&self) -> Option<CrosstalkMatrix> {
        match &self.recipe {
            RecipeDiagnostics::Fast(fast) => fast.crosstalk,
            RecipeDiagnostics::Paper(_) => None,
        }
    }
}

/// Which color field was used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FieldOrigin {
    /// Name of its rig.
    pub rig: String,
    /// Name of its pattern set.
    pub set: String,
    /// "grid", "hash" or "frequency".
    pub form: &'static str,
    /// "sweep" or "projector".
    pub source: String,
}

impl From<&ColorField> for FieldOrigin {
    fn from(field: &ColorField) -> Self {
        let about = &field.metadata;
        let (rig, set, source) = (about.rig.clone(), about.set.clone(), about.source.clone());
        Self { rig, set, form: field.form_name(), source }
    }
}

/// What only one recipe knows.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum RecipeDiagnostics {
    /// Recipe `fast`.
    Fast(Box<FastDiagnostics>),
    /// Recipe `paper`.
    Paper(PaperDiagnostics),
}

/// What recipe `fast` puts on record.
#[derive(Clone, Debug, Serialize)]
pub struct FastDiagnostics {
    /// How much work was put in.
    pub effort: EffortSettings,
    /// Every number that the recipe used.
    pub fast: FastSettings,
    /// Where the initial surface came from.
    pub start: Start,
    /// The crosstalk matrix that was corrected; `None` for gray cameras and where it was not asked for.
    #[serde(rename = "mixing")]
    pub crosstalk: Option<CrosstalkMatrix>,
    /// Mean robust χ² per measurement after every step of the refinement.
    pub losses: Vec<f32>,
    /// Albedo per color channel, as far as interreflection tells it; 0 without gathered light.
    pub albedo: Vec<f32>,
    /// Median over the valid pixels of the median absolute residual, normalized intensity.
    pub median_residual: f32,
}

/// Where the initial surface came from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "from")]
pub enum Start {
    /// From the scene alone.
    #[serde(rename = "nothing")]
    Scene,
    /// From the previous frame's surface.
    #[serde(rename = "the frame before")]
    PreviousFrame {
        /// Fraction of the pixels that were decoded in the whole volume all the same.
        #[serde(rename = "found_anew")]
        decoded: f32,
    },
}

/// What recipe `paper` puts on record.
#[derive(Clone, Debug, Serialize)]
pub struct PaperDiagnostics {
    /// Iterations of the training.
    pub iterations: usize,
    /// Length of one unit of the field's cube, mm.
    pub unit_mm: f64,
    /// Losses and counts every hundred iterations.
    pub losses: Vec<TrainingRecord>,
}
