//! How much work a reconstruction puts in.

use serde::{Deserialize, Serialize};

/// How much work a reconstruction puts in. Nothing depends on the clock: the same effort gives the same result everywhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Effort {
    /// Soonest usable: decoded in a smaller picture, few steps
    Quick,
    /// Nearly all of the accuracy
    #[default]
    Normal,
    /// Until nothing changes any more
    Best,
}

/// What an [`Effort`] stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct EffortSettings {
    /// Most pixels that are decoded; a picture with more usable ones is decoded reduced, and refined in full.
    pub decoded_pixels: usize,
    /// Steps of the refinement.
    pub steps: usize,
    /// How often indirect light is gathered from the surface.
    pub gathers: usize,
    /// Most patches that the surface throws indirect light as.
    pub patches: usize,
}

impl Effort {
    /// What it stands for where a surface a moment earlier is known.
    pub fn warm(self) -> EffortSettings {
        let cold = self.settings();
        let steps = cold.steps.min(8);
        EffortSettings { steps, gathers: cold.gathers.min(2), ..cold }
    }

    /// What it stands for.
    pub fn settings(self) -> EffortSettings {
        match self {
            Effort::Quick => EffortSettings { decoded_pixels: 30_000, steps: 5, gathers: 2, patches: 1000 },
            Effort::Normal => EffortSettings { decoded_pixels: 400_000, steps: 24, gathers: 6, patches: 4000 },
            Effort::Best => EffortSettings { decoded_pixels: 400_000, steps: 48, gathers: 16, patches: 4000 },
        }
    }
}
