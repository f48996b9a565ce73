//! All settings of recipe `fast` in one struct, which `result.json` records whole.

use serde::Serialize;

use super::cost_volume::{CostVolumeSettings, HYPOTHESIS_PX};
use super::effort::EffortSettings;
use super::filter::FilterSettings;
use super::initialize::{CrosstalkSettings, PropagationSettings};
use super::light_fractions::LightFractionPrior;
use super::options::ReconstructionOptions;
use super::refine::RefineSettings;
use crate::color_field::LEAST_MODEL_SIGMA;

/// Settings of recipe `fast`, resolved from [`ReconstructionOptions`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FastSettings {
    /// Smallest standard deviation of the color field itself, normalized intensity.
    pub min_model_sigma: f32,
    /// Largest number of pixels that are decoded; an image with more valid ones is decoded reduced, and refined in
    /// full.
    pub max_decoded_pixels: usize,
    /// Smallest connected component that initialization accepts, px.
    pub min_component: usize,
    /// Cost volume and semi-global matching.
    pub cost_volume: CostVolumeSettings,
    /// Propagation of the previous frame's surface.
    pub propagation: PropagationSettings,
    /// Estimation of the crosstalk matrix from the scene.
    pub crosstalk: CrosstalkSettings,
    /// Prior of light that did not come directly from the light source.
    pub light_fractions: LightFractionPrior,
    /// Narrow-band refinement.
    pub refine: RefineSettings,
    /// Rejection of pixels.
    pub filter: FilterSettings,
}

impl FastSettings {
    /// Returns the settings of a scene without a previous frame.
    pub fn new(opts: &ReconstructionOptions) -> Self {
        let EffortSettings { decoded_pixels, steps, fine_steps, gathers, patches } = opts.effort.settings();
        Self {
            min_model_sigma: LEAST_MODEL_SIGMA,
            max_decoded_pixels: decoded_pixels,
            min_component: opts.min_component,
            cost_volume: CostVolumeSettings { max_hypotheses: opts.max_labels.max(16), p_jump: 0.01, p_step: 0.2 },
            propagation: PropagationSettings::default(),
            crosstalk: CrosstalkSettings::default(),
            light_fractions: LightFractionPrior::USUAL,
            refine: RefineSettings {
                steps: opts.steps.unwrap_or(steps),
                fine_steps: fine_steps.min(opts.steps.unwrap_or(steps)),
                settled: 0.0,
                first_width_mm: 0.7,
                last_width_mm: 0.1,
                loosened: 1.0,
                patches,
                gathers,
                first_gather: 2,
                roughness: opts.roughness / HYPOTHESIS_PX,
                ..RefineSettings::default()
            },
            filter: FilterSettings { min_component: opts.min_component, ..FilterSettings::default() },
        }
    }

    /// Returns the settings of a refinement that begins at the previous frame's surface: fewer steps, which end when
    /// the surface has settled, and a prior that is loosened at first.
    pub fn after_previous_frame(self, opts: &ReconstructionOptions) -> Self {
        let EffortSettings { steps, gathers, patches, .. } = opts.effort.after_previous_frame();
        let steps = opts.steps.unwrap_or(steps);
        let refine = RefineSettings {
            steps,
            fine_steps: 0,
            gathers,
            patches,
            settled: 0.01,
            loosened: 4.0,
            roughness_measurements: 2,
            first_gather: 0,
            ..self.refine
        };
        Self { refine, ..self }
    }
}
