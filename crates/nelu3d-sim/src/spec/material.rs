//! Surface materials.

use serde::{Deserialize, Serialize};

use super::defaults::one;

/// The reflection of a surface by direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum MaterialSpec {
    /// Diffuse: alike in all directions. It has braces so that keys it does not have are errors: of variants without,
    /// serde ignores them.
    Lambert {},
    /// A coating over a diffuse base: a microfacet reflection (GGX) of uncolored light, and below it what it lets
    /// through.
    Glossy {
        /// From 0.05 (nearly a mirror) to 1 (dull). The microfacets' slope is its square.
        roughness: f64,
        /// Share of light reflected head-on, 0 to 1; 0.04 for plastic and glass.
        #[serde(default = "plastic")]
        reflectance: f64,
    },
    /// Wax, marble, skin: a share of the light leaves the surface beside where it entered. The distance between the
    /// two, along the surface, is exponentially distributed.
    Translucent {
        /// Mean of that distance, mm.
        mean_free_path_mm: f64,
        /// Share of the light that does so, 0 to 1.
        #[serde(default = "one")]
        share: f64,
    },
}

impl Default for MaterialSpec {
    fn default() -> Self {
        Self::Lambert {}
    }
}

fn plastic() -> f64 {
    0.04
}
