//! Interreflection between surfaces.

use serde::{Deserialize, Serialize};

/// Light that reaches a surface by way of others, found by path tracing. Without bounces (the default) there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InterreflectionSpec {
    /// Surfaces on the way, at most, besides the one seen; 0: no interreflection.
    pub bounces: usize,
    /// Random paths per pixel, rounded up so that every ray of a pixel (`supersampling`²) has as many.
    pub paths_per_pixel: usize,
}

impl InterreflectionSpec {
    /// No interreflection.
    pub const OFF: Self = Self { bounces: 0, paths_per_pixel: 16 };

    /// Whether there is none.
    pub fn is_off(&self) -> bool {
        self.bounces == 0
    }
}

/// What an `[interreflection]` without keys means. A spec without it has [`InterreflectionSpec::OFF`].
impl Default for InterreflectionSpec {
    fn default() -> Self {
        Self { bounces: 3, paths_per_pixel: 16 }
    }
}
