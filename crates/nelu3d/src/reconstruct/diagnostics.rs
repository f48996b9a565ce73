//! Diagnostics of a reconstruction, typed; `result/` makes JSON of them.

use serde::Serialize;

use super::effort::EffortSettings;
use super::judge::drift_not_checked;
use super::neural::TrainingRecord;
use super::options::ReconstructionOptions;
use super::settings::FastSettings;
use crate::color_field::ColorField;
use crate::drift::DriftReport;
use crate::sensor::CrosstalkMatrix;
use crate::verdict::Judgment;

/// Diagnostics of a reconstruction: everything on record besides the surface and the times.
#[derive(Clone, Debug, Serialize)]
pub struct Diagnostics {
    /// Whether to trust the surface, and what that rests on.
    #[serde(skip)]
    pub judgment: Judgment,
    /// The settings that were asked for.
    pub settings: ReconstructionOptions,
    /// Name of the device that did the heavy work.
    pub device: String,
    /// The color field that was used.
    pub field: FieldOrigin,
    /// Whether camera or light moved since the sweep; `None` where no board in view told.
    pub drift: Option<DriftReport>,
    /// Diagnostics of the recipe that was used.
    #[serde(flatten)]
    pub recipe: RecipeDiagnostics,
}

impl Diagnostics {
    /// Adds what a look for drift found, or why nothing was looked at (a part of a sentence).
    pub(crate) fn add_drift(&mut self, found: Result<DriftReport, String>) {
        match found {
            Ok(drift) => {
                self.judgment.extend(drift.finding());
                self.drift = Some(drift);
            }
            Err(why) => self.judgment.add(drift_not_checked(&why)),
        }
    }

    /// Returns the crosstalk that was corrected; `None` where none can be (gray cameras, recipe `paper`).
    pub fn crosstalk(&self) -> Option<CrosstalkMatrix> {
        match &self.recipe {
            RecipeDiagnostics::Fast(fast) => fast.crosstalk,
            RecipeDiagnostics::Paper(_) => None,
        }
    }
}

/// The color field that was used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FieldOrigin {
    /// Name of its rig.
    pub rig: String,
    /// Name of its pattern set.
    pub set: String,
    /// Form of the field: "grid", "hash" or "frequency".
    pub form: &'static str,
    /// What the field was made from: "sweep" or "projector".
    pub source: String,
}

impl From<&ColorField> for FieldOrigin {
    fn from(field: &ColorField) -> Self {
        let metadata = &field.metadata;
        let (rig, set, source) = (metadata.rig.clone(), metadata.set.clone(), metadata.source.clone());
        Self { rig, set, form: field.form_name(), source }
    }
}

/// Diagnostics that belong to one recipe.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum RecipeDiagnostics {
    /// Diagnostics of recipe `fast`.
    Fast(Box<FastDiagnostics>),
    /// Diagnostics of recipe `paper`.
    Paper(PaperDiagnostics),
}

/// Diagnostics of recipe `fast`.
#[derive(Clone, Debug, Serialize)]
pub struct FastDiagnostics {
    /// How much work was put in.
    pub effort: EffortSettings,
    /// All settings of the recipe.
    pub fast: FastSettings,
    /// The origin of the initial surface.
    pub start: Start,
    /// The crosstalk matrix that was corrected; `None` for gray cameras and where it was not asked for.
    #[serde(rename = "mixing")]
    pub crosstalk: Option<CrosstalkMatrix>,
    /// Mean robust χ² per measurement after every step of the refinement.
    pub losses: Vec<f32>,
    /// Albedo per color channel, as far as interreflection determines it; 0 without gathered light.
    pub albedo: Vec<f32>,
    /// Crosstalk that was left beside that one and told by all pixels together; `None` where it was not asked for.
    pub mixing_left: Option<CrosstalkMatrix>,
    /// Where the flash was found to be from the patterns' light, across the light's direction, mm in the camera's frame;
    /// 0 where it is not told apart from it, `None` where that cannot be told (the light is not known, one or two
    /// patterns). Of a plane, it cannot be told from a factor of all light that changes across the picture.
    pub flash_offset_mm: Option<[f64; 3]>,
    /// Median over the valid pixels of the median absolute residual, normalized intensity.
    pub median_residual: f32,
}

/// The origin of the initial surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "from")]
pub enum Start {
    /// The surface was decoded from the scene alone.
    #[serde(rename = "nothing")]
    Scene,
    /// The surface was propagated from the previous frame's.
    #[serde(rename = "the frame before")]
    PreviousFrame {
        /// Fraction of the pixels that were decoded in the whole volume all the same.
        #[serde(rename = "found_anew")]
        decoded: f32,
    },
}

/// Diagnostics of recipe `paper`.
#[derive(Clone, Debug, Serialize)]
pub struct PaperDiagnostics {
    /// Number of iterations of the training.
    pub iterations: usize,
    /// Length of one unit of the field's cube, mm.
    pub unit_mm: f64,
    /// Losses and counts every hundred iterations.
    pub losses: Vec<TrainingRecord>,
}
