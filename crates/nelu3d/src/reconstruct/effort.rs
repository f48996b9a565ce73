//! The amount of work of a reconstruction.

use serde::{Deserialize, Serialize};

/// The amount of work of a reconstruction. Nothing depends on the clock: the same effort gives the same result
/// everywhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Effort {
    /// Fastest: decoded in a reduced image, few steps
    Quick,
    /// Nearly all of the accuracy
    #[default]
    Normal,
    /// Until nothing changes any more
    Best,
}

/// The amounts of work that an [`Effort`] stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct EffortSettings {
    /// Largest number of pixels that are decoded; an image with more valid ones is decoded reduced, and refined in
    /// full.
    pub decoded_pixels: usize,
    /// Number of steps of the refinement: in a reduced image, if there are any in the full one behind them.
    pub steps: usize,
    /// Number of steps in the full image that follow on those in a reduced one; 0 if all are in the full image.
    pub fine_steps: usize,
    /// Number of times that interreflection is gathered from the surface.
    pub gathers: usize,
    /// Largest number of patches that the surface reflects light from.
    pub patches: usize,
}

impl Effort {
    /// Returns the work of a refinement that begins at the previous frame's surface.
    pub fn after_previous_frame(self) -> EffortSettings {
        let cold = self.settings();
        let steps = cold.steps.min(8);
        EffortSettings { steps, fine_steps: 0, gathers: cold.gathers.min(2), patches: cold.patches.min(2000), ..cold }
    }

    /// Returns the work of a refinement that begins at a decoded surface.
    pub fn settings(self) -> EffortSettings {
        match self {
            Effort::Quick => {
                EffortSettings { decoded_pixels: 30_000, steps: 5, fine_steps: 0, gathers: 2, patches: 1000 }
            }
            Effort::Normal => {
                EffortSettings { decoded_pixels: 400_000, steps: 20, fine_steps: 8, gathers: 6, patches: 4000 }
            }
            Effort::Best => {
                EffortSettings { decoded_pixels: 400_000, steps: 48, fine_steps: 0, gathers: 16, patches: 4000 }
            }
        }
    }
}
