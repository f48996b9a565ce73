//! Interreflection between surfaces.

use serde::{Deserialize, Serialize};

/// Interreflection between surfaces, found by path tracing. Without bounces (the default) there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InterreflectionSpec {
    /// Maximum number of surfaces on a path besides the one seen; 0: no interreflection.
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

/// The meaning of an `[interreflection]` section without keys. A spec without it has [`InterreflectionSpec::OFF`].
impl Default for InterreflectionSpec {
    fn default() -> Self {
        Self { bounces: 3, paths_per_pixel: 16 }
    }
}
